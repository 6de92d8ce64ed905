"""What the commands share: how they end, what they show, the files they are given."""

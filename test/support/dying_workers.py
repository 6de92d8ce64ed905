"""What a process does that ends before it has done anything; in a module of its own, which is imported quickly."""
import os
import signal


def killed(_connection, _threads):
    """As by the system where memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)


def failing(_connection, _threads):
    """As after an exception that nobody expects."""
    os._exit(3)

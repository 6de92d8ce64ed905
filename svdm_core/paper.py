"""The paper's own figures: M. Gan Yeou Wei, R. A. Hamzah, N. S. Nik Anwar, A. I. Herman and J. A. J. Alsayaydeh,
"Improvement of horizontal streak on disparity map thru parameter optimization for stereo vision algorithm", 2024.

Table 6: avgerr of the 15 training scenes of Middlebury v3 in full-resolution px (the table heads them with %), over the
visible pixels (nonocc) and over all.
"""
from __future__ import annotations

PAPER_AVGERR: dict[str, dict[str, float]] = {
    'Adirondack': {'nonocc': 4.88, 'all': 5.92},
    'ArtL': {'nonocc': 6.81, 'all': 12.4},
    'Jadeplant': {'nonocc': 15.3, 'all': 30.2},
    'Motorcycle': {'nonocc': 4.24, 'all': 6.52},
    'MotorcycleE': {'nonocc': 7.42, 'all': 9.24},
    'Piano': {'nonocc': 5.82, 'all': 6.44},
    'PianoL': {'nonocc': 12.7, 'all': 13.0},
    'Pipes': {'nonocc': 7.26, 'all': 12.2},
    'Playroom': {'nonocc': 8.12, 'all': 13.2},
    'Playtable': {'nonocc': 17.1, 'all': 19.5},
    'PlaytableP': {'nonocc': 4.12, 'all': 4.94},
    'Recycle': {'nonocc': 4.43, 'all': 4.66},
    'Shelves': {'nonocc': 11.0, 'all': 11.2},
    'Teddy': {'nonocc': 3.38, 'all': 4.79},
    'Vintage': {'nonocc': 13.4, 'all': 14.3},
}

# The table's own weighted average.
PAPER_WEIGHTED: dict[str, float] = {'nonocc': 7.58, 'all': 10.6}

"""What the paper published, as data.

Melvin Gan Yeou Wei, Rostam Affendi Hamzah, Nik Syahrim Nik Anwar, Adi Irwan Herman, Jamil Abedalrahim Jamil Alsayaydeh:
"Improvement of horizontal streak on disparity map thru parameter optimization for stereo vision algorithm", 2024.
"""
from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True, slots=True)
class PaperStudyTable:
    """One table of the paper's parameter study: a parameter varied, the others as the tables before left them.

    nonocc, everywhere: weighted average error of the 15 training pairs of Middlebury v3 at quarter resolution, of the
    visible and of all pixels, one a value. The paper writes %; they are px of the full resolution. chosen: the value
    the paper goes on with.
    """

    number: int
    parameter: str
    values: tuple[int | float, ...]
    nonocc: tuple[float, ...]
    everywhere: tuple[float, ...]
    chosen: int | float


PAPER_STUDY = (
    PaperStudyTable(
        2, 'alpha',
        (10.0, 10.1, 10.2, 10.3, 10.4, 10.5, 10.6, 10.7, 10.8, 10.9, 11.0),
        (9.53, 9.49, 9.47, 9.48, 9.49, 9.48, 9.47, 9.46, 9.46, 9.47, 9.46),
        (13.0, 12.9, 12.9, 12.9, 12.9, 12.9, 12.9, 12.8, 12.9, 12.9, 12.9),
        10.7),
    PaperStudyTable(
        3, 'sigma_s',
        (15.0, 15.1, 15.2, 15.3, 15.4, 15.5, 15.6, 15.7, 15.8, 15.9, 16.0),
        (7.68, 7.67, 7.67, 7.67, 7.67, 7.67, 7.66, 7.66, 7.65, 7.65, 7.65),
        (10.9,) * 11,
        15.8),
    PaperStudyTable(
        4, 'sigma_c',
        (0.170, 0.171, 0.172, 0.173, 0.174, 0.175, 0.176, 0.177, 0.178, 0.179, 0.180),
        (7.61,) * 11,
        (10.9, 10.9, 10.9, 10.9, 10.9, 10.8, 10.8, 10.8, 10.8, 10.8, 10.9),
        0.175),
    PaperStudyTable(
        5, 'w_p',
        (1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31, 33, 35, 37, 39),
        (8.97, 8.26, 7.97, 7.81, 7.70, 7.61, 7.59, 7.56, 7.55, 7.56, 7.53, 7.54, 7.54, 7.55, 7.57, 7.58, 7.58, 7.61,
         7.61, 7.60),
        (12.3, 11.5, 11.2, 11.1, 11.0, 10.8, 10.8, 10.8, 10.8, 10.9, 10.7, 10.7, 10.7, 10.7, 10.7, 10.6, 10.6, 10.7,
         10.6, 10.6),
        31),
)
"""Tables 2 to 5, in the paper's order. Its text gives the step of Table 3 as 0.01; the table has 0.1."""

PAPER_STUDY_START: dict[str, int | float] = {'alpha': 1.0, 'sigma_s': 1.0, 'sigma_c': 0.1, 'w_p': 11}
"""Section 3.5: the values before the study; preset paper_start has them."""

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
"""Table 6: avgerr of each scene in full-resolution px (its head says %), of the visible pixels (nonocc) and of all."""

PAPER_WEIGHTED: dict[str, float] = {'nonocc': 7.58, 'all': 10.6}
"""The weighted average of Table 6, as the paper gives it."""

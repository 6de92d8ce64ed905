"""From messages to what is matched: two rectified images, cut out and shrunk, their geometry and search range."""
from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ..calibration.geometry import StereoGeometry, stereo_geometry
from ..calibration.rectification import Calibration, calibration_of
from .preparation import PreparedPair, prepare, with_search_range
from .views import FrameError, StereoFrame, View, Views

if TYPE_CHECKING:
    from ..node.parameter_set import NodeParameters


class PreparedFrame(NamedTuple):
    """pair: what is matched. parameters: with the search range of `min_depth`. whole: geometry of the rectified images
    before `roi` and `downscale`. problem: what is wrong with the range, if anything. calibrations: all that the two
    camera_info say, of each camera; None where there is none. arrived, raw: as of the StereoFrame."""

    pair: PreparedPair
    parameters: NodeParameters
    whole: StereoGeometry
    problem: str
    calibrations: tuple[Calibration | None, Calibration | None]
    arrived: float
    raw: bool

    @property
    def search(self) -> tuple[int, int]:
        """min_disparity, num_disparities."""
        return self.parameters.matcher.min_disparity, self.parameters.matcher.num_disparities

    @property
    def row_setting(self) -> object:
        """What the vertical offsets depend on, besides the cameras: compares equal where it is the same."""
        return (self.calibrations, self.pair.geometry, self.parameters.region, self.parameters.downscale, self.raw,
                self.pair.left.shape[:2], self.search)


class FramePreparation:
    """Keeps the maps of raw cameras until their calibration changes. For one thread at a time."""

    def __init__(self) -> None:
        self._views = Views()

    def of(self, frame: StereoFrame, parameters: NodeParameters) -> PreparedFrame:
        """Raises FrameError for anything that is wrong with the pair."""
        left, right = self._views.of(frame)
        height, width = left.pixels.shape[:2]
        whole = stereo_geometry(left.info, right.info, width, height, parameters.baseline)
        try:
            pair = prepare(left.pixels, right.pixels, whole, parameters)
        except ValueError as error:
            raise FrameError('not within the image', f'pair dropped: {error}') from error
        parameters, problem = with_search_range(parameters, pair.geometry)
        return PreparedFrame(pair, parameters, whole, problem, (_calibration(left), _calibration(right)), frame.arrived,
                             frame.raw)


def _calibration(view: View) -> Calibration | None:
    height, width = view.pixels.shape[:2]
    return None if view.info is None else calibration_of(view.info, width, height)

"""Which topics of a recording are the stereo pair, and where their camera_info and ground truth are."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import PurePosixPath

from svdm_core.shown import cut

from .recording import RecordingError, Topic

IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
DISPARITY = 'stereo_msgs/msg/DisparityImage'

_SIDES = (('left', 'right'), ('Left', 'Right'), ('infra1', 'infra2'), ('cam0', 'cam1'), ('image_00', 'image_01'))
"""How drivers tell the left camera from the right in the name of a topic."""
_GROUND_TRUTH = ('ground_truth', 'gt')


@dataclasses.dataclass(frozen=True, slots=True)
class StereoTopics:
    """Names of topics; None where the recording has none. left and right are one where an image holds both views."""

    left: str
    right: str
    left_info: str | None = None
    right_info: str | None = None
    ground_truth: str | None = None

    @property
    def infos(self) -> list[str]:
        """The camera_info topics there are."""
        return [name for name in (self.left_info, self.right_info) if name]

    @property
    def together(self) -> bool:
        """Whether one image holds both views."""
        return self.left == self.right

    @property
    def info_names(self) -> tuple[str, str]:
        """Where the camera_info of the left and of the right belongs, whether it is there or not."""
        if self.together:
            folder = PurePosixPath(_without_transport(self.left)).parent
            return str(folder / 'left' / 'camera_info'), str(folder / 'right' / 'camera_info')
        return _info_name(self.left), _info_name(self.right)


def find_stereo_topics(
    topics: Mapping[str, Topic], left: str | None = None, right: str | None = None, raw: bool = False
) -> StereoTopics:
    """The pair named by `left` and `right`, or the only one there is.

    Of several, rectified images come before others, or after them where `raw` ones are wanted, and plain ones before
    their compressed copies.
    Raises RecordingError that lists what there is.
    """
    images = _images(topics)
    if left or right:
        pair = _named(images, left, right)
    else:
        pair = _only_one(images, [topics[name] for name in sorted(images)], _is_unrectified if raw else _is_rectified)
    return _with_infos(topics, *pair)


def find_side_by_side(topics: Mapping[str, Topic], image: str | None = None, raw: bool = False) -> StereoTopics:
    """The topic whose images hold both views: `image`, or the only one there is.

    Of several, rectified images come before others, or after them where `raw` ones are wanted, and plain ones before
    their compressed copies. Raises RecordingError that lists what there is.
    """
    images = _images(topics)
    if image is not None:
        _check_there(images, image)
        return _with_infos(topics, image, image)
    found = sorted(images)
    for preferred in (_is_unrectified if raw else _is_rectified, _is_plain):
        found = [name for name in found if preferred(name)] or found
    if len(found) > 1:
        raise RecordingError(f'{len(found)} topics may hold images of both views, name one with --left: '
                             f'{_listed(topics[name] for name in found)}')
    return _with_infos(topics, found[0], found[0])


def _images(topics: Mapping[str, Topic]) -> set[str]:
    images = {name for name, topic in topics.items() if topic.message_type in (IMAGE, COMPRESSED) and topic.count}
    if not images:
        raise RecordingError(f'no images in it: {_listed(topics.values())}')
    return images


def _with_infos(topics: Mapping[str, Topic], left: str, right: str) -> StereoTopics:
    pair = StereoTopics(left, right)
    left_info, right_info = (_info(topics, name) for name in pair.info_names)
    return dataclasses.replace(pair, left_info=left_info, right_info=right_info, ground_truth=_ground_truth(topics))


def _named(images: set[str], left: str | None, right: str | None) -> tuple[str, str]:
    if not (left and right):
        raise RecordingError('--left and --right belong together: name both topics')
    if left == right:
        raise RecordingError(f'--left and --right are both {cut(left)}: a pair needs two topics, or '
                             '--set layout=side_by_side where one image holds both views')
    for name in (left, right):
        _check_there(images, name)
    return left, right


def _check_there(images: set[str], name: str) -> None:
    if name not in images:
        raise RecordingError(f'no images on {cut(name)}: there are images on {", ".join(map(cut, sorted(images)))}')


def _only_one(images: set[str], found: list[Topic], first: Callable[[str], bool]) -> tuple[str, str]:
    pairs = [(name, partner) for name in sorted(images) for partner in _partners(name) if partner in images]
    for preferred in (first, _is_plain):
        pairs = [pair for pair in pairs if preferred(pair[0])] or pairs
    if len(pairs) == 1:
        return pairs[0]
    if pairs:
        several = '; '.join(f'--left {cut(left)} --right {cut(right)}' for left, right in pairs)
        raise RecordingError(f'{len(pairs)} stereo pairs in it, choose one: {several}')
    lone = [(name, partner) for name in sorted(images) for partner in _partners(name)]
    if lone:
        raise RecordingError(f'only one side: images on {cut(lone[0][0])} but none on {cut(lone[0][1])}; '
                             f'name the topics with --left and --right: {_listed(found)}')
    raise RecordingError(f'no stereo pair found by name: name the topics with --left and --right: {_listed(found)}')


def _partners(name: str) -> list[str]:
    return [name.replace(left, right) for left, right in _SIDES if left in name]


def _is_rectified(name: str) -> bool:
    return 'rect' in _without_transport(name).rpartition('/')[2]


def _is_unrectified(name: str) -> bool:
    return not _is_rectified(name)


def _is_plain(name: str) -> bool:
    return _without_transport(name) == name


def _without_transport(name: str) -> str:
    """The topic that a compressed one is a copy of."""
    return name.removesuffix('/compressed')


def _info_name(image: str) -> str:
    """The camera_info topic that goes with an image topic."""
    return str(PurePosixPath(_without_transport(image)).parent / 'camera_info')


def _info(topics: Mapping[str, Topic], name: str) -> str | None:
    found = topics.get(name)
    return name if found and found.message_type == CAMERA_INFO and found.count else None


def _ground_truth(topics: Mapping[str, Topic]) -> str | None:
    """The only disparity topic that calls itself ground truth."""
    names = _called_ground_truth(topics, DISPARITY)
    return names[0] if len(names) == 1 else None


def ground_truth_lines(topics: Mapping[str, Topic]) -> Iterator[str]:
    """Why results are not judged by what calls itself ground truth; nothing where they are, or where nothing does."""
    names, images = _called_ground_truth(topics, DISPARITY), _called_ground_truth(topics, IMAGE)
    if len(names) > 1:
        yield f'results are not judged, as there are {len(names)} topics of ground truth: {", ".join(names)}'
    elif images and not names:
        yield f'results are not judged by {images[0]}, it is {IMAGE}: ground truth must be {DISPARITY}'


def _called_ground_truth(topics: Mapping[str, Topic], message_type: str) -> list[str]:
    return [name for name, topic in topics.items() if topic.message_type == message_type and topic.count
            and any(part in _GROUND_TRUTH for part in PurePosixPath(name).parts)]


def _listed(topics: Iterable[Topic]) -> str:
    """Name, type and count of each."""
    texts = [f'{cut(topic.name)} ({cut(topic.message_type.rpartition("/")[2])}, {topic.count})' for topic in topics]
    return f'it holds {", ".join(texts)}' if texts else 'it is empty'

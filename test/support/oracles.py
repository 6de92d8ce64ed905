"""Naive oracles of the kernels: float64, plain loops, written from the equations."""
import itertools

import numpy as np


def full_scale(image):
    return 255.0 if image.dtype == np.uint8 else 65535.0


def channels(image):
    """(H, W, C) float64 on 0..1."""
    return image.reshape(*image.shape[:2], -1) / full_scale(image)


def gradient(grey, kind):
    """Eqs 3-5 with replicated borders; 'horizontal' is halved."""
    image = grey / full_scale(grey)
    height, width = image.shape
    result = np.empty(image.shape)
    for y, x in np.ndindex(*image.shape):
        gx = image[y, min(x + 1, width - 1)] - image[y, max(x - 1, 0)]
        gy = image[min(y + 1, height - 1), x] - image[max(y - 1, 0), x]
        result[y, x] = gx / 2 if kind == 'horizontal' else np.hypot(gx, gy)
    return result


def census(grey):
    """uint8 (H, 9, W): 34 bits in reading order of a 7x5 window, four to a byte, 1 where the neighbour is darker;
    borders replicated."""
    height, width = grey.shape
    result = np.zeros((height, 9, width), np.uint8)
    offsets = [(i, j) for i, j in itertools.product(range(-2, 3), range(-3, 4)) if (i, j) != (0, 0)]
    for y, x in np.ndindex(*grey.shape):
        for bit, (i, j) in enumerate(offsets):
            neighbour = grey[min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)]
            result[y, bit // 4, x] |= int(neighbour < grey[y, x]) << bit % 4
    return result


def differing(census_left, census_right, y, x, partner):
    """Bits of the census of pixel (y, x) that differ from its partner's."""
    return int(np.bitwise_count(census_left[y, :, x] ^ census_right[y, :, partner]).sum())


def matching_cost(left, right, gradient_left, gradient_right, census_left, census_right, parameters):
    """Eqs 1-8, and the share of census bits that differ, as a volume (H, W, D)."""
    a, b = channels(left), channels(right)
    height, width = left.shape[:2]
    largest = parameters.tau_ad + parameters.alpha * parameters.tau_gm + parameters.census_weight
    cost = np.full((height, width, parameters.num_disparities), largest)
    for y, x, j in np.ndindex(*cost.shape):
        partner = x - parameters.min_disparity - j
        if 0 <= partner < width:
            ad = np.abs(a[y, x] - b[y, partner]).mean()
            gm = abs(gradient_left[y, x] - gradient_right[y, partner])
            cost[y, x, j] = min(ad, parameters.tau_ad) + parameters.alpha * min(gm, parameters.tau_gm)
            bits = differing(census_left, census_right, y, x, partner)
            cost[y, x, j] += parameters.census_weight * bits / 34
    return cost


def byte_cost(own, other, own_census, other_census, costs, lanes, largest):
    """Costs of one view (H, W, lanes) as `byte_costs` defines them, in exact integers.

    own, other: int (C + 1, H, W), values of both views in their own direction; costs: the numbers of `ByteCosts`.
    """
    own, other = own.astype(int), other.astype(int)
    height, _, width = own_census.shape if costs.bit else own[0, :, None].shape
    result = np.full((height, width, lanes), largest)
    within = int((costs.behind == 0).sum())
    for y, x, d in np.ndindex(height, width, within):
        partner = x - costs.start - d
        if not 0 <= partner < width:
            continue
        total = int(costs.bit) * differing(own_census, other_census, y, x, partner) if costs.bit else 0
        if costs.has_differences:
            apart = np.abs(own[:, y, x] - other[:, y, partner])
            colour = apart[0] if len(apart) == 2 else (apart[:3] * 21846 >> 16).sum()
            for difference, tau, widen, weight in (
                    (colour, costs.tau_ad, costs.widen_ad, costs.weight_ad),
                    (apart[-1], costs.tau_gm, costs.widen_gm, costs.weight_gm)):
                total += min(int(difference), int(tau)) * int(widen) * int(weight) >> 16
        result[y, x, d] = total + 64 >> 7
    return result


def grid_edges(guide):
    """(weight, pixel, pixel) of the 4-connected grid: the largest channel difference in grey levels."""
    height, width = guide.shape[:2]
    levels = guide.reshape(height, width, -1).astype(int)
    edges = []
    for y, x in np.ndindex(height, width):
        for other_y, other_x in ((y, x + 1), (y + 1, x)):
            if other_y < height and other_x < width:
                weight = np.abs(levels[y, x] - levels[other_y, other_x]).max()
                edges.append((int(weight), y * width + x, other_y * width + other_x))
    return edges


def spanning_tree_weight(guide):
    """Kruskal: weight of a minimum spanning tree of the grid."""
    height, width = guide.shape[:2]
    component = list(range(height * width))
    total = 0
    for weight, a, b in sorted(grid_edges(guide)):
        old, new = component[a], component[b]
        if old != new:
            total += weight
            component = [new if c == old else c for c in component]
    return total


def support(parent, weight, sigma_tree, d_y):
    """Support of node q for node p, (N, N): exp(-D / (255 sigma)), D along the tree, 0 across a cut (eqs 10-13)."""
    nodes = len(parent)
    distance = np.full((nodes, nodes), np.inf)
    for k in range(nodes):
        distance[k, k] = 0
        if k and weight[k] <= d_y:
            for other in range(k):
                distance[k, other] = distance[other, k] = distance[parent[k], other] + float(weight[k])
    return np.exp(-distance / (255 * sigma_tree))


def box_bytes(volume):
    """Sum of each pixel's 3x3 neighbours in a volume (H, W, D), the borders replicated; cut off at 255, a quarter."""
    height, width = volume.shape[:2]
    total = np.zeros_like(volume)
    for y, x in np.ndindex(height, width):
        for i, j in itertools.product((-1, 0, 1), repeat=2):
            total[y, x] += volume[min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)]
    return np.minimum(total + 2, 255) // 4


def path_costs(volume, step, p1, p2):
    """L of one direction over a volume (H, W, D) of bytes, cut off at 255: the pixel before (y, x) is (y, x) - step.

    p2: int (H, W), of the step to each pixel from the left or from above, whichever way it is taken.
    """
    height, width, disparities = volume.shape
    costs = np.zeros(volume.shape, int)
    rows = range(height) if step[0] >= 0 else range(height - 1, -1, -1)
    columns = range(width) if step[1] >= 0 else range(width - 1, -1, -1)
    for y, x in itertools.product(rows, columns):
        before = y - step[0], x - step[1]
        if not (0 <= before[0] < height and 0 <= before[1] < width):
            costs[y, x] = volume[y, x]
            continue
        last, jump = costs[before], p2[max(y, before[0]), max(x, before[1])]
        for d in range(disparities):
            ways = [last[d], min(last.min() + jump, 255)]
            ways += [min(last[other] + p1, 255) for other in (d - 1, d + 1) if 0 <= other < disparities]
            costs[y, x, d] = min(volume[y, x, d] + min(ways) - last.min(), 255)
    return costs


def path_sums(volume, p1, across, down, paths):
    """Three paths added up, or two means of two, cut off at 255."""
    left, right, above, below = (path_costs(volume, step, p1, p2) for step, p2 in (
        ((0, 1), across), ((0, -1), across), ((1, 0), down), ((-1, 0), down)))
    if paths == 3:
        return np.minimum(np.minimum(left + right, 255) + above, 255)
    return np.minimum((left + right + 1) // 2 + (above + below + 1) // 2, 255)


def stripe_sums(volume, p1, across, down, paths, size, overlap):
    """`path_sums` by stripes of `size` rows, whose vertical paths begin `overlap` rows outside."""
    height = len(volume)
    result = []
    for first in range(0, height, size):
        last = min(first + size, height)
        low, high = max(0, first - overlap), min(height, last + overlap) if paths == 4 else last
        rows = slice(low, high)
        result.append(path_sums(volume[rows], p1, across[rows], down[rows], paths)[first - low:last - low])
    return np.concatenate(result)


def edges(image):
    """(across, down), int (H, W): largest channel difference to the pixels on the left and above, 0 at the border."""
    planes = image.reshape(*image.shape[:2], -1).astype(int)
    across, down = np.zeros((2, *image.shape[:2]), int)
    across[:, 1:] = np.abs(planes[:, 1:] - planes[:, :-1]).max(axis=2)
    down[1:] = np.abs(planes[1:] - planes[:-1]).max(axis=2)
    return across, down


def symmetric_v(below, best, above):
    """Where two lines of opposite slopes meet, the steeper side's, through three equidistant values."""
    slope = max(below, above) - best
    if slope == 0:
        return 0.0
    return (below - above) / (2 * slope)


def runs(wanted):
    """[first, end] of each run of True in a row."""
    edges = np.flatnonzero(np.diff(np.r_[0, wanted, 0].astype(int)))
    return edges.reshape(-1, 2).tolist()


def margin(sums):
    """255 (m2 / m1 - 1), at most 255: m1 the smallest sum of a pixel, m2 the smallest beyond its neighbours."""
    winner = int(np.argmin(sums))
    rivals = [255, *(int(value) for d, value in enumerate(sums) if abs(d - winner) > 1)]
    least = int(sums[winner])
    return min(255, int(255 * (min(rivals) - least) / max(least, 1)))


def left_right_check(left, right, min_disparity, tau_lr):
    """Eq 15; left and right are disparities less min_disparity."""
    valid = np.zeros(left.shape, bool)
    for y, x in np.ndindex(*left.shape):
        partner = x - (left[y, x] + min_disparity)
        inside = 0 <= partner < left.shape[1]
        valid[y, x] = inside and abs(int(left[y, x]) - int(right[y, partner])) <= tau_lr
    return valid


def fill(disparity, valid):
    """Eq 16: the smaller of the nearest valid ones on the row, the only one there is, or itself."""
    filled = disparity.copy()
    for y, x in zip(*np.nonzero(~valid), strict=True):
        on_row = np.flatnonzero(valid[y])
        nearest = [*on_row[on_row < x][-1:], *on_row[on_row > x][:1]]
        if nearest:
            filled[y, x] = min(disparity[y, q] for q in nearest)
    return filled


def median_histogram(labels, guide, y, x, window, sigma_s, sigma_c, step=1):
    """Eqs 17-18: h(p, d) as {label: weight} of the window around (y, x), cut off at the border; guide (C, H, W). step:
    px from row to row, which are multiples of it."""
    height, width = labels.shape
    radius = window // 2
    histogram = {}
    middle = y // step * step
    rows = [v for v in range(middle - radius // step * step, middle + radius + 1, step) if 0 <= v < height]
    columns = range(max(0, x - radius), min(width, x + radius + 1))
    for v, u in itertools.product(rows, columns):
        spatial = ((v - y) ** 2 + (u - x) ** 2) / sigma_s**2
        similarity = ((guide[:, y, x].astype(float) - guide[:, v, u]) ** 2).sum() / sigma_c**2
        label = int(labels[v, u])
        histogram[label] = histogram.get(label, 0.0) + np.exp(-spatial - similarity)
    return histogram


def is_weighted_median(label, histogram, tolerance=1e-4):
    """Whether `label` is the smallest one up to which half of the weight lies (eq 19), rounding forgiven."""
    half = sum(histogram.values()) / 2
    below = sum(weight for other, weight in histogram.items() if other < label)
    up_to = below + histogram.get(label, 0.0)
    return label in histogram and below < half * (1 + tolerance) and up_to >= half * (1 - tolerance)


def confidence(valid, margin, grey, least_texture):
    """The mean of margins of valid pixels in 9 x 9, 0 beyond the image; 0 where the mean |Sobel x| / 8 in 9 x 7,
    borders replicated, is below `least_texture`."""
    height, width = valid.shape
    padded = np.pad(grey.astype(int), 1, mode='edge')
    across = padded[:, 2:] - padded[:, :-2]
    slope = np.pad(np.abs(across[:-2] + 2 * across[1:-1] + across[2:]) / 8, ((3, 3), (4, 4)), mode='edge')
    trusted = np.pad(np.where(valid, margin / 255, 0), 4)
    result = np.zeros(valid.shape)
    for y, x in np.ndindex(height, width):
        if slope[y:y + 7, x:x + 9].mean() >= least_texture:
            result[y, x] = trusted[y:y + 9, x:x + 9].mean()
    return result


def far_histogram(labels, valid, guide, y, x, column):
    """Eqs 17-18 over valid pixels of a sparse window: every column-th pixel of a row, 15 of every second of them around
    the one that holds x, in 15 rows as far apart around the one that holds y; guide (C, H, W) on 0..1."""
    height, width = labels.shape
    histogram = {}
    for i, j in itertools.product(range(-7, 8), repeat=2):
        row = y // (2 * column) + i
        v, u = min((2 * row + 1) * column, height - 1), min((x // column + 2 * j) * column + column // 2, width - 1)
        if 0 <= row < -(-height // (2 * column)) and 0 <= x // column + 2 * j < -(-width // column) and valid[v, u]:
            unlike = ((guide[:, y, x].astype(float) - guide[:, v, u]) ** 2).sum() / 0.04**2
            label = int(labels[v, u])
            histogram[label] = histogram.get(label, 0.0) + np.exp(-(i * i + j * j) / 4.0**2 - unlike)
    return histogram


def plane_fit(disparity, support, guide):
    """Each disparity, px, by the height of the plane e = a + b dx + c dy through 15 pixels (dx 0, +-4, +-8; dy 0, +-6),
    e the difference to it: weights support (1 - (e / (1 + 0.15 (|dx| + |dy|)))^2)^2 (1 - (m / 0.1)^2)^2, m the largest
    difference of a channel; 1 px^2 added to the variances of dx and dy. guide (C, H, W) on 0..1."""
    height, width = disparity.shape
    result = disparity.astype(float)
    for y, x in np.ndindex(height, width):
        rows = []
        for dy, dx in itertools.product((-6, 0, 6), (-8, -4, 0, 4, 8)):
            if 0 <= y + dy < height and 0 <= x + dx < width:
                e = float(disparity[y + dy, x + dx]) - float(disparity[y, x])
                near = max(0.0, 1 - (e / (1 + 0.15 * (abs(dx) + abs(dy))))**2)**2
                m = np.abs(guide[:, y, x].astype(float) - guide[:, y + dy, x + dx]).max()
                rows.append((support[y + dy, x + dx] * near * max(0.0, 1 - (m / 0.1)**2)**2, dx, dy, e))
        weight, *values = np.array(rows).T
        mean = np.average(values, axis=1, weights=weight)
        spread = np.cov(values, aweights=weight, ddof=0)
        slopes = np.linalg.solve(spread[:2, :2] + np.eye(2), spread[:2, 2])
        result[y, x] += mean[2] - slopes @ mean[:2]
    return result

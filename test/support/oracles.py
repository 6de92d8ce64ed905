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
    """uint64 (H, W): 62 bits, in reading order of a 9x7 window, 1 where the neighbour is darker; borders replicated."""
    height, width = grey.shape
    result = np.empty(grey.shape, np.uint64)
    for y, x in np.ndindex(*grey.shape):
        bits = 0
        for i, j in itertools.product(range(-3, 4), range(-4, 5)):
            if (i, j) != (0, 0):
                neighbour = grey[min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)]
                bits = 2 * bits + int(neighbour < grey[y, x])
        result[y, x] = bits
    return result


def matching_cost(left, right, gradient_left, gradient_right, census_left, census_right, parameters):
    """Eqs 1-8, and the share of census bits that differ, as a volume (H, W, D)."""
    a, b = channels(left), channels(right)
    height, width = left.shape[:2]
    largest = parameters.tau_ad + parameters.alpha * parameters.tau_gm + parameters.census_weight
    cost = np.full((height, width, parameters.num_disparities), largest)
    for y, x, j in np.ndindex(*cost.shape):
        partner = x - parameters.min_disparity - j
        if partner >= 0:
            ad = np.abs(a[y, x] - b[y, partner]).mean()
            gm = abs(gradient_left[y, x] - gradient_right[y, partner])
            cost[y, x, j] = min(ad, parameters.tau_ad) + parameters.alpha * min(gm, parameters.tau_gm)
            differing = bin(int(census_left[y, x]) ^ int(census_right[y, partner])).count('1')
            cost[y, x, j] += parameters.census_weight * differing / 62
    return cost


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


def box_sum(volume):
    """Sum of each pixel's 3x3 neighbours in a volume (H, W, D), the borders replicated."""
    height, width = volume.shape[:2]
    total = np.zeros_like(volume)
    for y, x in np.ndindex(height, width):
        for i, j in itertools.product((-1, 0, 1), repeat=2):
            total[y, x] += volume[min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)]
    return total


def path_costs(volume, step, p1, p2):
    """L of one direction over a volume (H, W, D): the pixel before (y, x) is (y, x) - step; p2(before, here)."""
    height, width, disparities = volume.shape
    costs = np.zeros_like(volume)
    rows = range(height) if step[0] >= 0 else range(height - 1, -1, -1)
    columns = range(width) if step[1] >= 0 else range(width - 1, -1, -1)
    for y, x in itertools.product(rows, columns):
        before = y - step[0], x - step[1]
        if not (0 <= before[0] < height and 0 <= before[1] < width):
            costs[y, x] = volume[y, x]
            continue
        last = costs[before]
        for d in range(disparities):
            ways = [last[d], last.min() + p2(before, (y, x))]
            ways += [last[other] + p1 for other in (d - 1, d + 1) if 0 <= other < disparities]
            costs[y, x, d] = volume[y, x, d] + min(ways) - last.min()
    return costs


def jump_penalty(image, p1, p2, p2_edge):
    """p2(before, here) for `path_costs`: smaller where the largest channel difference is large, p1 at least."""
    planes = image.reshape(*image.shape[:2], -1).astype(int)

    def penalty(before, here):
        edge = np.abs(planes[before] - planes[here]).max()
        return max(round(p2 / (1 + edge / p2_edge)), p1)

    return penalty


def symmetric_v(below, best, above):
    """Where two lines of opposite slopes meet, the steeper side's, through three equidistant values."""
    slope = max(below, above) - best
    if slope == 0:
        return 0.0
    return (below - above) / (2 * slope)


def left_right_check(left, right, min_disparity, tau_lr):
    """Eq 15; left and right are disparities less min_disparity."""
    valid = np.zeros(left.shape, bool)
    for y, x in np.ndindex(*left.shape):
        partner = x - (left[y, x] + min_disparity)
        valid[y, x] = partner >= 0 and abs(int(left[y, x]) - int(right[y, partner])) <= tau_lr
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


def median_histogram(labels, guide, y, x, window, sigma_s, sigma_c):
    """Eqs 17-18: h(p, d) as {label: weight} of the window around (y, x), cut off at the border; guide (C, H, W)."""
    height, width = labels.shape
    radius = window // 2
    histogram = {}
    rows = range(max(0, y - radius), min(height, y + radius + 1))
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

"""Antialiasing along silhouettes, driven by their edges: kernels for `fabcraft.fit.render`.

Looking for the silhouette only among the edges of the triangle seen at a pixel loses most of it on fine
meshes, because at a rim the triangles are foreshortened to less than a pixel. Here the silhouette edges
themselves are walked.

An edge is on the silhouette when it has one face, or when both its faces lie on the same side of it in the
picture. A steep edge is followed over the rows, a flat one over the columns. Where it passes between the
centres of two neighbouring pixels, the inner one covered and the outer one showing something farther away,
there is a *crossing*, at distance t in [0, 1] from the inner centre. Of the crossings of one pair the
outermost counts. With C the picture before, and C_rim the surface at the crossing itself,

    t < 1/2:  C(inner) += (1/2 - t) (C(outer) - C_rim),
    t > 1/2:  C(outer) += (t - 1/2) (C_rim - C(outer)),

so that every picture is box-filtered to first order, and its derivative along the rim is right.
"""

import typing

import numba as nb
import numpy as np

from fabcraft.fit.shading import (
    add3,
    corners_of,
    face_sign,
    fragment,
    fragment_backward,
    pixel_backward,
    pixel_fragment,
    read,
    shade_backward,
    unproject,
)
from fabcraft.geometry.raster import band_rows, pixel_range


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def _side(screen, a, b, c):
    """Twice the signed area of a, b, c in the picture."""
    return (screen[b, 0] - screen[a, 0]) * (screen[c, 1] - screen[a, 1]) - (screen[c, 0] - screen[a, 0]) * (
        screen[b, 1] - screen[a, 1]
    )


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _inner_side(screen, edges, edge):
    """The side of a silhouette edge on which its faces lie; 0 for any other edge.

    A face seen exactly edge-on has no side: the other one decides.
    """
    a, b, o, p = edges[edge, 0], edges[edge, 1], edges[edge, 2], edges[edge, 3]
    first = _side(screen, a, b, o)
    if p < 0:
        return first
    second = _side(screen, a, b, p)
    if (first > 0.0 and second >= 0.0) or (first < 0.0 and second <= 0.0):
        return first
    return second if first == 0.0 else 0.0


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _walk_range(screen, edge_a, edge_b, height, width):
    """Axis across the edge (0: it is followed over the rows), first and end row or column."""
    dx, dy = screen[edge_b, 0] - screen[edge_a, 0], screen[edge_b, 1] - screen[edge_a, 1]
    axis = 0 if abs(dy) >= abs(dx) else 1
    low = min(screen[edge_a, 1 - axis], screen[edge_b, 1 - axis])
    high = max(screen[edge_a, 1 - axis], screen[edge_b, 1 - axis])
    if not (low <= high and high - low < np.inf):
        return axis, 0, 0
    first, end = pixel_range(low, high, 0, height if axis == 0 else width)
    return axis, first, end


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _slope(screen, key, a, b, c):
    """How fast the depth key changes a pixel, over the face a, b, c."""
    area = _side(screen, a, b, c)
    ku, kv = key[b] - key[a], key[c] - key[a]
    kx = (ku * (screen[c, 1] - screen[a, 1]) - kv * (screen[b, 1] - screen[a, 1])) / area
    ky = (kv * (screen[b, 0] - screen[a, 0]) - ku * (screen[c, 0] - screen[a, 0])) / area
    return abs(kx) + abs(ky)


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _walk_edge(screen, key, edges, edge, inner, face_id, nearest, pixels, places, keys, count):
    """Append the visible crossings of one silhouette edge, as far as there is room; the new count."""
    height, width = face_id.shape
    a, b, o, p = edges[edge, 0], edges[edge, 1], edges[edge, 2], edges[edge, 3]
    axis, first, end = _walk_range(screen, a, b, height, width)
    if first >= end:
        return count
    along_a, along_b = screen[a, 1 - axis], screen[b, 1 - axis]
    across_a, across_b = screen[a, axis], screen[b, axis]
    length = along_b - along_a
    positive = inner * length < 0.0 if axis == 0 else inner * length > 0.0
    # A rim may be nearer than the inner pixel centre by what its faces fall off within a pixel.
    slack = _slope(screen, key, a, b, o)
    if p >= 0:
        slack = max(slack, _slope(screen, key, a, b, p))
    for line in range(first, end):
        s = (line + 0.5 - along_a) / length
        if line + 0.5 >= max(along_a, along_b) or not (0.0 <= s <= 1.0):
            continue
        across = across_a + s * (across_b - across_a)
        if not (-1.0 <= across <= (width if axis == 0 else height) + 1.0):
            continue
        near = int(np.ceil(across - 0.5))
        inside, outside = (near, near - 1) if positive else (near - 1, near)
        if min(inside, outside) < 0 or max(inside, outside) >= (width if axis == 0 else height):
            continue
        r, c = (line, inside) if axis == 0 else (inside, line)
        q, d = (line, outside) if axis == 0 else (outside, line)
        edge_key = key[a] + s * (key[b] - key[a])
        if face_id[r, c] < 0 or not (edge_key < nearest[q, d] and nearest[r, c] <= edge_key + slack):
            continue
        if count < len(keys):
            pixels[count, 0], pixels[count, 1], pixels[count, 2] = r * width + c, q * width + d, edge
            places[count, 0], places[count, 1] = s, abs(across - inside - 0.5)
            keys[count] = edge_key
        count += 1
    return count


@nb.njit(cache=True)
@typing.no_type_check
def _sorted(order, digits, size):
    """`order` (N,), stably sorted by digits[order], which are below `size`."""
    starts = np.zeros(size + 1, np.int64)
    for i in range(len(order)):
        starts[digits[order[i]] + 1] += 1
    for digit in range(size):
        starts[digit + 1] += starts[digit]
    placed = np.empty_like(order)
    for i in range(len(order)):
        digit = digits[order[i]]
        placed[starts[digit]] = order[i]
        starts[digit] += 1
    return placed


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _keep_outermost(height, width, pixels, places, keys, count):
    """Keep, by pixel, one crossing a pixel pair: the outermost, else the nearest, else the first edge."""
    rows, codes, order = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    for i in range(count):
        step = pixels[i, 1] - pixels[i, 0]
        way = 0 if step == width else 1 if step == -width else 2 if step > 0 else 3
        rows[i], codes[i], order[i] = pixels[i, 0] // width, 4 * (pixels[i, 0] % width) + way, i
    order = _sorted(_sorted(order, codes, 4 * width), rows, height)
    found, spots = np.empty((count, 3), np.int32), np.empty((count, 2))
    kept, best = 0, -1
    for i in range(count):
        this = order[i]
        if best < 0 or codes[this] != codes[best] or rows[this] != rows[best]:
            best, kept = this, kept + 1
        elif places[this, 1] > places[best, 1] or (
            places[this, 1] == places[best, 1] and keys[this] < keys[best]
        ):
            best = this
        for part in range(3):
            found[kept - 1, part] = pixels[best, part]
        for part in range(2):
            spots[kept - 1, part] = places[best, part]
    for i in range(kept):
        for part in range(3):
            pixels[i, part] = found[i, part]
        for part in range(2):
            places[i, part] = spots[i, part]
    return kept


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _find_crossings(screen, key, edges, face_id, nearest, pixels, places):
    """Fill pixels (N, 3) inner, outer, edge, and places (N, 2) s along the edge, t; their number.

    More than N: nothing is of use, and there have to be that many rows.
    """
    keys, count = np.empty(len(pixels), np.float64), np.int64(0)
    for edge in range(len(edges)):
        inner = _inner_side(screen, edges, edge)
        if inner != 0.0:
            count = _walk_edge(screen, key, edges, edge, inner, face_id, nearest, pixels, places, keys, count)
    if count > len(pixels):
        return count
    return _keep_outermost(face_id.shape[0], face_id.shape[1], pixels, places, keys, count)


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _rim(screen, key, normals, faces, edges, edge, seen, s, light, ambient, orthographic):
    """Depth, normal (3) and shade at the place s of an edge, on the side that the face `seen` shows."""
    sign = face_sign(screen, faces[seen, 0], faces[seen, 1], faces[seen, 2])
    a, b = edges[edge, 0], edges[edge, 1]
    return fragment(screen, key, normals, a, b, a, 1.0 - s, s, 0.0, sign, light, ambient, orthographic)


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _blend_view(
    screen, key, normals, faces, edges, light, ambient, orthographic, face_id, pixels, places, count,
    mask, depth, normal, shaded,
):  # fmt: skip
    """Antialias the pictures (H, W) of one view in place."""
    width = face_id.shape[1]
    change = np.empty((count, 6), np.float64)
    for i in range(count):
        inner, outer = pixels[i, 0], pixels[i, 1]
        seen = face_id[inner // width, inner % width]
        z, nx, ny, nz, lit = _rim(
            screen, key, normals, faces, edges, pixels[i, 2], seen, places[i, 0], light, ambient, orthographic
        )
        share = 0.5 - places[i, 1]
        m, d, x, y, w, s = read(mask, depth, normal, shaded, outer // width, outer % width)
        change[i, 0], change[i, 1], change[i, 2] = share * (m - 1.0), share * (d - z), share * (x - nx)
        change[i, 3], change[i, 4], change[i, 5] = share * (y - ny), share * (w - nz), share * (s - lit)
    for i in range(count):
        target = pixels[i, 0] if places[i, 1] < 0.5 else pixels[i, 1]
        r, c = target // width, target % width
        if len(mask) > 0:
            mask[r, c] += change[i, 0]
        if len(depth) > 0:
            depth[r, c] += change[i, 1]
        if len(normal) > 0:
            add3(normal[r], c, change[i, 2], change[i, 3], change[i, 4])
        if len(shaded) > 0:
            shaded[r, c] += change[i, 5]


@nb.njit(cache=True, parallel=True, error_model="numpy")
@typing.no_type_check
def blend(
    screen, keys, normals, faces, edges, lights, ambient, orthographic, face_id, nearest,
    pixels, places, counts, mask, depth, normal, shaded,
):  # fmt: skip
    """Find the crossings of the views whose count (K,) is negative, and antialias their pictures (K, H, W).

    pixels (K, N, 3), places (K, N, 2): see `_find_crossings`. A view with more than N is left as it was, and its
    count becomes minus what it needs.
    """
    for view in nb.prange(len(counts)):
        if counts[view] < 0:
            counts[view] = _find_crossings(
                screen[view], keys[view], edges, face_id[view], nearest[view], pixels[view], places[view]
            )
            if counts[view] > pixels.shape[1]:
                counts[view] = -counts[view]
                continue
            _blend_view(
                screen[view], keys[view], normals, faces, edges, lights[view], ambient, orthographic,
                face_id[view], pixels[view], places[view], counts[view],
                mask[view], depth[view], normal[view], shaded[view],
            )  # fmt: skip


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _move_crossing(screen, a, b, axis, s, g_across, g_s, grad_screen):
    """Add the derivatives by the ends a and b from those by the position across the edge and by s."""
    length = screen[b, 1 - axis] - screen[a, 1 - axis]
    by_s = (g_s + g_across * (screen[b, axis] - screen[a, axis])) / length
    grad_screen[a, axis] += g_across * (1.0 - s)
    grad_screen[b, axis] += g_across * s
    grad_screen[a, 1 - axis] -= by_s * (1.0 - s)
    grad_screen[b, 1 - axis] -= by_s * s


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _blend_backward(
    screen, key, normals, faces, edges, light, ambient, orthographic, face_id, pixels, places, count,
    g_mask, g_depth, g_normal, g_shaded, to_screen, to_normals,
):  # fmt: skip
    """Add the derivatives of `_blend_view` to to_screen and to_normals (V, 3)."""
    width = face_id.shape[1]
    for i in range(count):
        inner, outer, edge = pixels[i, 0], pixels[i, 1], pixels[i, 2]
        s, share = places[i, 0], 0.5 - places[i, 1]
        target = inner if share > 0.0 else outer
        gm, gd, gx, gy, gz, gs = read(g_mask, g_depth, g_normal, g_shaded, target // width, target % width)
        seen = face_id[inner // width, inner % width]
        behind = face_id[outer // width, outer % width]
        z, nx, ny, nz, lit = _rim(
            screen, key, normals, faces, edges, edge, seen, s, light, ambient, orthographic
        )
        jump = -gm - gd * z - gx * nx - gy * ny - gz * nz - gs * lit
        if behind >= 0:
            a, b, c = corners_of(faces, behind)
            px, py = outer % width + 0.5, outer // width + 0.5
            z, nx, ny, nz, lit = pixel_fragment(
                screen, key, normals, a, b, c, px, py, light, ambient, orthographic
            )
            jump += gm + gd * z + gx * nx + gy * ny + gz * nz + gs * lit
            pixel_backward(
                screen, key, normals, a, b, c, px, py, light, ambient, orthographic,
                share * gd, share * gx, share * gy, share * gz, share * gs, to_screen, to_normals,
            )  # fmt: skip
        a, b = np.uintp(edges[edge, 0]), np.uintp(edges[edge, 1])
        sign = face_sign(screen, faces[seen, 0], faces[seen, 1], faces[seen, 2])
        g0, g1, _ = fragment_backward(
            screen, key, normals, a, b, a, 1.0 - s, s, 0.0, sign, light, ambient, orthographic,
            -share * gd, -share * gx, -share * gy, -share * gz, -share * gs, to_screen, to_normals,
        )  # fmt: skip
        axis = 1 if abs(outer - inner) == width else 0
        # t grows with the position across the edge when the outer pixel has the larger index
        _move_crossing(screen, a, b, axis, s, -jump if outer > inner else jump, g1 - g0, to_screen)


@nb.njit(cache=True, parallel=True, error_model="numpy")
@typing.no_type_check
def backward(
    screen, keys, normals, faces, edges, lights, ambient, orthographic, bands, face_id,
    pixels, places, counts, g_mask, g_depth, g_normal, g_shaded, rows, centre, near, by_points, by_normals,
):  # fmt: skip
    """Derivatives of the antialiased pictures by the world points and the normals: (tasks, V, 3), to be summed."""
    for task in nb.prange(len(by_points)):
        view, start, end = band_rows(task, bands, face_id.shape[1])
        by_points[task].fill(0.0)
        by_normals[task].fill(0.0)
        if g_depth.shape[1] + g_normal.shape[1] + g_shaded.shape[1] > 0:  # the mask does not change inside
            shade_backward(
                screen[view], keys[view], normals, faces, lights[view], ambient, orthographic, start, end,
                face_id[view], g_mask[view], g_depth[view], g_normal[view], g_shaded[view],
                by_points[task], by_normals[task],
            )  # fmt: skip
        if task % bands == 0:
            _blend_backward(
                screen[view], keys[view], normals, faces, edges, lights[view], ambient, orthographic,
                face_id[view], pixels[view], places[view], counts[view],
                g_mask[view], g_depth[view], g_normal[view], g_shaded[view], by_points[task], by_normals[task],
            )  # fmt: skip
        unproject(screen[view], rows[view], centre, near, orthographic, by_points[task])

"""Which triangle is seen at which pixel: a z-buffer, and the antialiased silhouette of a triangle soup.

Pixel coordinates: columns grow to the right, rows downwards; the centre of pixel (column c, row r) lies at
(c + 0.5, r + 0.5), as in `fabcraft.geometry.plane`. A smaller depth is nearer. Depth is interpolated
linearly over the image, which is right for an orthographic view; for a perspective one hand in -1/z.

Watertight: the two faces at an edge evaluate it from the same end point, and a centre exactly on the edge
belongs to the face below it or to the right of it (top-left rule). Where two faces are equally near, the one
with the lower index is seen. The work is shared out by bands of rows and each pixel belongs to one band, so
the result does not depend on the number of threads.
"""

import typing
from typing import NamedTuple

import numba as nb
import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, Integer

BANDS = 8
"""Bands of rows for one picture; fixed, so that sums by band come out the same on every machine."""
TILE = 8
"""Side of the squares, px, of which the farthest depth is kept."""


class Raster(NamedTuple):
    """What is seen at every pixel centre."""

    face_id: Int32[np.ndarray, "H W"]
    """Index of the nearest face; -1 where there is none."""
    barycentric: Float32[np.ndarray, "H W 3"]
    """Weights of its three corners, linear over the image; 0 where there is none."""
    depth: Float32[np.ndarray, "H W"]
    """Its depth; +inf where there is none."""


def rasterize(
    corners_px: Float64[np.ndarray, "V 3"], faces: Int32[np.ndarray, "F 3"], width: int, height: int
) -> Raster:
    """The nearest triangle at every pixel centre of a `height` x `width` image; both windings are seen.

    corners_px : (V, 3), column and row in pixel coordinates, depth (any unit, smaller is nearer).
    faces : (F, 3), indices into `corners_px`. A face without area, or with a coordinate that is not finite,
        is skipped.
    """
    points, triangles = np.array(corners_px)[None], _read_only(faces)
    face_id = np.empty((1, height, width), np.int32)
    depth = np.empty((1, height, width))
    barycentric = np.zeros((height, width, 3), np.float32)
    zbuffer(points, points[..., 2].copy(), triangles, BANDS, face_id, depth)
    _barycentric(points[0], triangles, face_id[0], barycentric)
    return Raster(face_id[0], barycentric, depth[0].astype(np.float32))


def silhouette_mask(
    points: Float[np.ndarray, "V 2"],
    faces: Integer[np.ndarray, "F 3"],
    width: int,
    height: int,
    supersample: int = 4,
) -> Float32[np.ndarray, "H W"]:
    """The share of every pixel that the union of the triangles covers, from supersample² points a pixel.

    points : (V, 2), column and row in pixel coordinates (`Plane.to_pixels` of x and z).
    """
    fine = np.zeros((1, len(points), 3))
    fine[0, :, :2] = points * float(supersample)
    face_id = np.empty((1, height * supersample, width * supersample), np.int32)
    zbuffer(fine, fine[..., 2].copy(), _read_only(faces), BANDS, face_id, np.empty(face_id.shape))
    covered = (face_id[0] >= 0).reshape(height, supersample, width * supersample)
    columns = covered.sum(1, dtype=np.int32).reshape(height, width, supersample)
    return (columns.sum(2) / supersample**2).astype(np.float32)


def _read_only(faces: Integer[np.ndarray, "F 3"]) -> Int32[np.ndarray, "F 3"]:
    """A copy that may not be written to, so that the kernels are compiled for one kind of array only."""
    triangles = np.array(faces, dtype=np.int32)
    triangles.setflags(write=False)
    return triangles


def bands_for(views: int) -> int:
    """How many bands of rows a picture is cut into when `views` of them are drawn side by side."""
    return max(1, -(-BANDS // views)) if views else 1


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def band_rows(task, bands, height):
    """View, first row and end row of a task; a thread's run of tasks is spread over the picture."""
    view, place = task // bands, task % bands
    odd_from = (bands + 1) // 2
    band = 2 * place if place < odd_from else 2 * (place - odd_from) + 1
    return view, band * height // bands, (band + 1) * height // bands


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def pixel_range(low, high, start, end):
    """First and end index in [start, end) of the pixels whose centre lies in [low, high]."""
    first = max(low - 0.5, start - 1.0)
    last = min(high - 0.5, end + 1.0)
    return max(int(np.ceil(first)), start), min(int(np.floor(last)) + 1, end)


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def _edge(xa, ya, xb, yb):
    """Edge a -> b as u, v, x_ref, y_ref of e = u * (y - y_ref) - v * (x - x_ref); whether 0 is inside.

    The reference point is the same for a -> b and b -> a, so that e changes nothing but its sign.
    """
    level = ya == yb
    inclusive = (yb < ya) | (level & (xb > xa))
    from_a = (ya < yb) | (level & (xa < xb))
    return xb - xa, yb - ya, xa if from_a else xb, ya if from_a else yb, inclusive


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _draw_face(x0, y0, x1, y1, x2, y2, k0, k1, k2, face, start, end, width, face_id, depth):
    """Draw one triangle into rows [start, end) of one picture, (H * W,)."""
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if not (abs(area) > 1e-14 and abs(area) < np.inf and abs(k0 + k1 + k2) < np.inf):
        return
    if area < 0.0:
        x1, y1, k1, x2, y2, k2, area = x2, y2, k2, x1, y1, k1, -area
    row, row_end = pixel_range(min(y0, y1, y2), max(y0, y1, y2), start, end)
    col, col_end = pixel_range(min(x0, x1, x2), max(x0, x1, x2), 0, width)
    if row >= row_end or col >= col_end:
        return
    # Edge i lies opposite corner i, so that b_i = e_i / area.
    u0, v0, xr0, yr0, on0 = _edge(x1, y1, x2, y2)
    u1, v1, xr1, yr1, on1 = _edge(x2, y2, x0, y0)
    u2, v2, xr2, yr2, on2 = _edge(x0, y0, x1, y1)
    scale = 1.0 / area
    for r in range(row, row_end):
        py = r + 0.5
        f0, f1, f2 = u0 * (py - yr0), u1 * (py - yr1), u2 * (py - yr2)
        for c in range(col, col_end):
            px = c + 0.5
            e0, e1, e2 = f0 - v0 * (px - xr0), f1 - v1 * (px - xr1), f2 - v2 * (px - xr2)
            if min(e0, e1, e2) < 0.0:
                continue
            if (e0 > 0.0 or on0) and (e1 > 0.0 or on1) and (e2 > 0.0 or on2):
                k, at = (e0 * k0 + e1 * k1 + e2 * k2) * scale, np.uintp(r * width + c)
                if k < depth[at] or (k == depth[at] and face < face_id[at]):
                    depth[at] = k
                    face_id[at] = face


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def _corners(points, keys, faces, face):
    """Columns, rows and depth keys of the three corners."""
    # unsigned: an index that may be negative costs a comparison at every use
    a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
    return (
        points[a, 0], points[a, 1], points[b, 0], points[b, 1], points[c, 0], points[c, 1],
        keys[a], keys[b], keys[c],
    )  # fmt: skip


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _farthest(depth, start, end, width, tiles):
    """The largest depth in every tile of rows [start, end); +inf where a pixel shows nothing."""
    tiles[:] = -np.inf
    for r in range(start, end):
        for c in range(width):
            tile = np.uintp((r - start) // TILE), np.uintp(c // TILE)
            tiles[tile] = max(tiles[tile], depth[np.uintp(r * width + c)])


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _hidden(x0, y0, x1, y1, x2, y2, nearest, start, end, width, tiles):
    """Whether a face of which nothing is nearer than `nearest` lies behind all there is; no for a large one."""
    row, row_end = pixel_range(min(y0, y1, y2), max(y0, y1, y2), start, end)
    col, col_end = pixel_range(min(x0, x1, x2), max(x0, x1, x2), 0, width)
    if row >= row_end or col >= col_end:
        return True
    top, bottom = (row - start) // TILE, (row_end - 1 - start) // TILE
    left, right = col // TILE, (col_end - 1) // TILE
    if bottom - top > 1 or right - left > 1:
        return False
    return nearest > max(tiles[top, left], tiles[top, right], tiles[bottom, left], tiles[bottom, right])


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _draw_rows(xy, key, faces, start, end, face_id, depth):
    """Draw all faces into rows [start, end) of one picture.

    Faces seen from behind come last: those of a closed surface lie behind what is drawn by then, which a glance
    at the few tiles around them tells.
    """
    width = face_id.shape[1]
    ids, nearest = face_id.reshape(-1), depth.reshape(-1)
    ids[start * width : end * width] = -1
    nearest[start * width : end * width] = np.inf
    later, count = np.empty(len(faces), np.int32), 0
    for face in range(len(faces)):
        x0, y0, x1, y1, x2, y2, k0, k1, k2 = _corners(xy, key, faces, face)
        if max(y0, y1, y2) < start or min(y0, y1, y2) > end:
            continue
        if (x1 - x0) * (y2 - y0) > (x2 - x0) * (y1 - y0):
            later[count] = face
            count += 1
        else:
            _draw_face(x0, y0, x1, y1, x2, y2, k0, k1, k2, face, start, end, width, ids, nearest)
    tiles = np.empty(((end - start) // TILE + 1, width // TILE + 1))
    _farthest(nearest, start, end, width, tiles)
    for place in range(count):
        face = np.int64(later[place])  # one kind of number, one compilation
        x0, y0, x1, y1, x2, y2, k0, k1, k2 = _corners(xy, key, faces, face)
        if not _hidden(x0, y0, x1, y1, x2, y2, min(k0, k1, k2), start, end, width, tiles):
            _draw_face(x0, y0, x1, y1, x2, y2, k0, k1, k2, face, start, end, width, ids, nearest)


@nb.njit(cache=True, parallel=True, error_model="numpy")
@typing.no_type_check
def zbuffer(points, keys, faces, bands, face_id, depth):
    """Fill face_id (K, H, W) and depth (K, H, W) from points (K, V, 3) and their depth keys (K, V)."""
    for task in nb.prange(face_id.shape[0] * bands):
        view, start, end = band_rows(task, bands, face_id.shape[1])
        _draw_rows(points[view], keys[view], faces, start, end, face_id[view], depth[view])


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _barycentric(points, faces, face_id, barycentric):
    """Weights of the corners of the face that is seen, at every pixel centre."""
    for r in range(face_id.shape[0]):
        for c in range(face_id.shape[1]):
            face = face_id[r, c]
            if face >= 0:
                x0, y0 = points[faces[face, 0], 0], points[faces[face, 0], 1]
                x1, y1 = points[faces[face, 1], 0], points[faces[face, 1], 1]
                x2, y2 = points[faces[face, 2], 0], points[faces[face, 2], 1]
                area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
                px, py = c + 0.5, r + 0.5
                b0 = ((y1 - y2) * (px - x2) + (x2 - x1) * (py - y2)) / area
                b1 = ((y2 - y0) * (px - x2) + (x0 - x2) * (py - y2)) / area
                barycentric[r, c, 0], barycentric[r, c, 1], barycentric[r, c, 2] = b0, b1, 1.0 - b0 - b1

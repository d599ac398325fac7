"""What a pixel shows of a triangle, and how that depends on the vertices: kernels for `fabcraft.fit.render`.

A *fragment* is a point of the surface, given by three corners and weights b_i that are linear over the
picture. With q_i = 1 in an orthographic view and q_i = 1 / z_i in a perspective one,

    w_i = b_i q_i / sum_j b_j q_j,    depth = sum_i w_i z_i,    n = +-sum_i w_i n_i / |...|,
    shade = ambient + (1 - ambient) max(0, n . light).

The sign turns the normal of a face seen from behind towards the camera, so that open sheets are lit on both
sides. At a pixel centre p the weights are the barycentric ones; moving corner i by d changes b_j by
-b_i (grad b_j . d).

Arrays: screen (V, 3) column, row, depth; key (V,) what the z-buffer compares, z or -1/z; normals (V, 3),
world, or (0, 3) when only depth is wanted; light (3,), world, towards the light. Derivatives are added to
grad_screen (V, 3) and grad_normals (V, 3). A picture that is not wanted has no rows.
"""

import typing

import numba as nb
import numpy as np

from fabcraft.geometry.raster import band_rows


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def face_sign(screen, a, b, c):
    """+1 for a face seen from outside (clockwise with rows downwards), -1 for one seen from behind."""
    area = (screen[b, 0] - screen[a, 0]) * (screen[c, 1] - screen[a, 1])
    area -= (screen[c, 0] - screen[a, 0]) * (screen[b, 1] - screen[a, 1])
    return 1.0 if area < 0.0 else -1.0


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def read(mask, depth, normal, shaded, view, row, column):
    """Mask, depth, normal (3) and shade of a pixel; 0 for a picture that is not wanted."""
    m = mask[view, row, column] if mask.shape[1] > 0 else 0.0
    d = depth[view, row, column] if depth.shape[1] > 0 else 0.0
    s = shaded[view, row, column] if shaded.shape[1] > 0 else 0.0
    if normal.shape[1] == 0:
        return m, d, 0.0, 0.0, 0.0, s
    return m, d, normal[view, row, column, 0], normal[view, row, column, 1], normal[view, row, column, 2], s


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def pixel_weights(screen, a, b, c, px, py):
    """Barycentric weights of the point (px, py), and the derivatives of the first two by px and py."""
    x0, y0, x1, y1 = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
    x2, y2 = screen[c, 0], screen[c, 1]
    scale = 1.0 / ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    u0, v0 = (y1 - y2) * scale, (x2 - x1) * scale
    u1, v1 = (y2 - y0) * scale, (x0 - x2) * scale
    b0 = u0 * (px - x2) + v0 * (py - y2)
    b1 = u1 * (px - x2) + v1 * (py - y2)
    return b0, b1, 1.0 - b0 - b1, u0, v0, u1, v1


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def perspective_weights(key, a, b, c, b0, b1, b2, orthographic):
    """w_0, w_1, w_2 and the sum of b_j q_j."""
    if orthographic:
        return b0, b1, b2, 1.0
    u0, u1, u2 = -b0 * key[a], -b1 * key[b], -b2 * key[c]
    total = u0 + u1 + u2
    return u0 / total, u1 / total, u2 / total, total


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def blend_normals(normals, a, b, c, w0, w1, w2, sign):
    """Unit normal of a fragment, and the length it had before (0 where it has none)."""
    x = sign * (w0 * normals[a, 0] + w1 * normals[b, 0] + w2 * normals[c, 0])
    y = sign * (w0 * normals[a, 1] + w1 * normals[b, 1] + w2 * normals[c, 1])
    z = sign * (w0 * normals[a, 2] + w1 * normals[b, 2] + w2 * normals[c, 2])
    length = np.sqrt(x * x + y * y + z * z)
    if length < 1e-9:
        return 0.0, 0.0, 0.0, 0.0
    return x / length, y / length, z / length, length


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def fragment(screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic):
    """Depth, normal (3) and shade of a fragment; without normals when `normals` is empty."""
    w0, w1, w2, _ = perspective_weights(key, a, b, c, b0, b1, b2, orthographic)
    depth = w0 * screen[a, 2] + w1 * screen[b, 2] + w2 * screen[c, 2]
    if len(normals) == 0:
        return depth, 0.0, 0.0, 0.0, 0.0
    nx, ny, nz, _ = blend_normals(normals, a, b, c, w0, w1, w2, sign)
    lit = max(0.0, nx * light[0] + ny * light[1] + nz * light[2])
    return depth, nx, ny, nz, ambient + (1.0 - ambient) * lit


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def pixel_fragment(screen, key, normals, a, b, c, px, py, light, ambient, orthographic):
    """Depth, normal (3) and shade of the face a, b, c at the pixel centre (px, py)."""
    b0, b1, b2, _, _, _, _ = pixel_weights(screen, a, b, c, px, py)
    sign = face_sign(screen, a, b, c)
    return fragment(screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic)


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def fragment_backward(
    screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic,
    g_depth, gx, gy, gz, g_shade, grad_screen, grad_normals,
):  # fmt: skip
    """Derivatives by b_0, b_1, b_2; those by depths and normals are added to the arrays."""
    w0, w1, w2, total = perspective_weights(key, a, b, c, b0, b1, b2, orthographic)
    grad_screen[a, 2] += g_depth * w0
    grad_screen[b, 2] += g_depth * w1
    grad_screen[c, 2] += g_depth * w2
    g0, g1, g2 = g_depth * screen[a, 2], g_depth * screen[b, 2], g_depth * screen[c, 2]
    if len(normals) > 0:
        nx, ny, nz, length = blend_normals(normals, a, b, c, w0, w1, w2, sign)
        if length > 0.0:
            if g_shade != 0.0 and nx * light[0] + ny * light[1] + nz * light[2] > 0.0:
                lit = (1.0 - ambient) * g_shade
                gx, gy, gz = gx + lit * light[0], gy + lit * light[1], gz + lit * light[2]
            along = gx * nx + gy * ny + gz * nz
            scale = sign / length
            gx, gy, gz = scale * (gx - along * nx), scale * (gy - along * ny), scale * (gz - along * nz)
            g0 += gx * normals[a, 0] + gy * normals[a, 1] + gz * normals[a, 2]
            g1 += gx * normals[b, 0] + gy * normals[b, 1] + gz * normals[b, 2]
            g2 += gx * normals[c, 0] + gy * normals[c, 1] + gz * normals[c, 2]
            for corner, w in ((a, w0), (b, w1), (c, w2)):
                grad_normals[corner, 0] += w * gx
                grad_normals[corner, 1] += w * gy
                grad_normals[corner, 2] += w * gz
    if orthographic:
        return g0, g1, g2
    mean = g0 * w0 + g1 * w1 + g2 * w2
    g0, g1, g2 = (g0 - mean) / total, (g1 - mean) / total, (g2 - mean) / total
    # q = -key = 1 / z, so that dq/dz = -q²
    grad_screen[a, 2] -= g0 * b0 * key[a] * key[a]
    grad_screen[b, 2] -= g1 * b1 * key[b] * key[b]
    grad_screen[c, 2] -= g2 * b2 * key[c] * key[c]
    return -g0 * key[a], -g1 * key[b], -g2 * key[c]


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def pixel_backward(
    screen, key, normals, a, b, c, px, py, light, ambient, orthographic,
    g_depth, gx, gy, gz, g_shade, grad_screen, grad_normals,
):  # fmt: skip
    """Add the derivatives of what the pixel centre (px, py) shows of the face a, b, c."""
    b0, b1, b2, u0, v0, u1, v1 = pixel_weights(screen, a, b, c, px, py)
    sign = face_sign(screen, a, b, c)
    h0, h1, h2 = fragment_backward(
        screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic,
        g_depth, gx, gy, gz, g_shade, grad_screen, grad_normals,
    )  # fmt: skip
    along_x = (h0 - h2) * u0 + (h1 - h2) * u1
    along_y = (h0 - h2) * v0 + (h1 - h2) * v1
    for corner, weight in ((a, b0), (b, b1), (c, b2)):
        grad_screen[corner, 0] -= weight * along_x
        grad_screen[corner, 1] -= weight * along_y


@nb.njit(cache=True, parallel=True, error_model="numpy")
@typing.no_type_check
def shade(
    screen, keys, normals, faces, lights, ambient, orthographic, bands, face_id, mask, depth, normal, shaded
):
    """Fill the pictures (K, H, W) from the face seen at every pixel centre."""
    height, width = face_id.shape[1], face_id.shape[2]
    for task in nb.prange(face_id.shape[0] * bands):
        view, start, end = band_rows(task, bands, height)
        corners, key, light = screen[view], keys[view], lights[view]
        for r in range(start, end):
            for col in range(width):
                face = face_id[view, r, col]
                cover, d, nx, ny, nz, lit = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                if face >= 0:
                    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                    d, nx, ny, nz, lit = pixel_fragment(
                        corners, key, normals, a, b, c, col + 0.5, r + 0.5, light, ambient, orthographic
                    )
                    cover = 1.0
                if mask.shape[1] > 0:
                    mask[view, r, col] = cover
                if depth.shape[1] > 0:
                    depth[view, r, col] = d
                if normal.shape[1] > 0:
                    normal[view, r, col, 0] = nx
                    normal[view, r, col, 1] = ny
                    normal[view, r, col, 2] = nz
                if shaded.shape[1] > 0:
                    shaded[view, r, col] = lit


@nb.njit(cache=True, parallel=True, error_model="numpy")
@typing.no_type_check
def shade_backward(
    screen, keys, normals, faces, lights, ambient, orthographic, bands, face_id,
    g_mask, g_depth, g_normal, g_shaded, grad_screen, grad_normals,
):  # fmt: skip
    """Add the derivatives of `shade` to grad_screen and grad_normals (tasks, V, 3), one slice a task."""
    height, width = face_id.shape[1], face_id.shape[2]
    for task in nb.prange(face_id.shape[0] * bands):
        view, start, end = band_rows(task, bands, height)
        corners, key, light = screen[view], keys[view], lights[view]
        to_screen, to_normals = grad_screen[task], grad_normals[task]
        for r in range(start, end):
            for col in range(width):
                face = face_id[view, r, col]
                if face < 0:
                    continue
                _, gd, gx, gy, gz, gs = read(g_mask, g_depth, g_normal, g_shaded, view, r, col)
                if gd == 0.0 and gx == 0.0 and gy == 0.0 and gz == 0.0 and gs == 0.0:
                    continue
                pixel_backward(
                    corners, key, normals, faces[face, 0], faces[face, 1], faces[face, 2], col + 0.5, r + 0.5,
                    light, ambient, orthographic, gd, gx, gy, gz, gs, to_screen, to_normals,
                )  # fmt: skip


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def _sides(vertices, a, b, c):
    """b - a and c - a."""
    return (
        vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2],
        vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2],
    )  # fmt: skip


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def vertex_normals(vertices, faces, normals, lengths):
    """Area-weighted unit normals (V, 3), and the lengths (V,) of the sums they were made of."""
    normals[:] = 0.0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x1, y1, z1, x2, y2, z2 = _sides(vertices, a, b, c)
        x, y, z = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
        for corner in (a, b, c):
            normals[corner, 0] += x
            normals[corner, 1] += y
            normals[corner, 2] += z
    for v in range(len(normals)):
        lengths[v] = np.sqrt(normals[v, 0] ** 2 + normals[v, 1] ** 2 + normals[v, 2] ** 2)
        for axis in range(3):
            normals[v, axis] = normals[v, axis] / lengths[v] if lengths[v] > 0.0 else 0.0


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def vertex_normals_backward(vertices, faces, normals, lengths, grad, grad_vertices):
    """Add to grad_vertices what the derivatives `grad` (V, 3) by the normals say; `grad` is overwritten."""
    for v in range(len(normals)):
        along = grad[v, 0] * normals[v, 0] + grad[v, 1] * normals[v, 1] + grad[v, 2] * normals[v, 2]
        for axis in range(3):
            across = grad[v, axis] - along * normals[v, axis]
            grad[v, axis] = across / lengths[v] if lengths[v] > 0.0 else 0.0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x1, y1, z1, x2, y2, z2 = _sides(vertices, a, b, c)
        x, y, z = grad[a, 0], grad[a, 1], grad[a, 2]
        x, y, z = x + grad[b, 0], y + grad[b, 1], z + grad[b, 2]
        x, y, z = x + grad[c, 0], y + grad[c, 1], z + grad[c, 2]
        # g . (e1 x e2) = e1 . (e2 x g) = e2 . (g x e1)
        for axis, by_1, by_2 in (
            (0, y2 * z - z2 * y, y * z1 - z * y1),
            (1, z2 * x - x2 * z, z * x1 - x * z1),
            (2, x2 * y - y2 * x, x * y1 - y * x1),
        ):
            grad_vertices[b, axis] += by_1
            grad_vertices[c, axis] += by_2
            grad_vertices[a, axis] -= by_1 + by_2

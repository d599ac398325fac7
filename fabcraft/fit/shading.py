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
def read(mask, depth, normal, shaded, row, column):
    """Mask, depth, normal (3) and shade of a pixel; 0 for a picture that is not wanted."""
    m = mask[row, column] if len(mask) > 0 else 0.0
    d = depth[row, column] if len(depth) > 0 else 0.0
    s = shaded[row, column] if len(shaded) > 0 else 0.0
    if len(normal) == 0:
        return m, d, 0.0, 0.0, 0.0, s
    return m, d, normal[row, column, 0], normal[row, column, 1], normal[row, column, 2], s


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def corners_of(faces, face):
    """The three corners of a face, unsigned: an index that may be negative costs a comparison at every use."""
    return np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])


@nb.njit(cache=True, error_model="numpy", inline="always")
@typing.no_type_check
def pixel_weights(screen, a, b, c, px, py):
    """Barycentric weights of the point (px, py), the derivatives of the first two by px and py, `face_sign`."""
    x2, y2 = screen[c, 0], screen[c, 1]
    x0, y0, x1, y1 = screen[a, 0] - x2, screen[a, 1] - y2, screen[b, 0] - x2, screen[b, 1] - y2
    scale = 1.0 / (x0 * y1 - x1 * y0)
    u0, v0, u1, v1 = y1 * scale, -x1 * scale, -y0 * scale, x0 * scale
    b0 = u0 * (px - x2) + v0 * (py - y2)
    b1 = u1 * (px - x2) + v1 * (py - y2)
    return b0, b1, 1.0 - b0 - b1, u0, v0, u1, v1, 1.0 if scale < 0.0 else -1.0


@nb.njit(cache=True, error_model="numpy", inline="always")
@typing.no_type_check
def projected_weights(key, a, b, c, b0, b1, b2, orthographic):
    """b_0 q_0, b_1 q_1, b_2 q_2: in the ratio of the weights w, whose sum is 1."""
    if orthographic:
        return b0, b1, b2
    return -b0 * key[a], -b1 * key[b], -b2 * key[c]


@nb.njit(cache=True, error_model="numpy", inline="always")
@typing.no_type_check
def mixed_normal(normals, a, b, c, r0, r1, r2, sign):
    """Unit normal of a fragment, and sign / |sum r_i n_i| (0 where it has none)."""
    x = r0 * normals[a, 0] + r1 * normals[b, 0] + r2 * normals[c, 0]
    y = r0 * normals[a, 1] + r1 * normals[b, 1] + r2 * normals[c, 1]
    z = r0 * normals[a, 2] + r1 * normals[b, 2] + r2 * normals[c, 2]
    length = np.sqrt(x * x + y * y + z * z)
    scale = sign / length if length > 1e-9 * (r0 + r1 + r2) else 0.0
    return x * scale, y * scale, z * scale, scale


@nb.njit(cache=True, error_model="numpy", inline="always")
@typing.no_type_check
def fragment(screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic):
    """Depth, normal (3) and shade of a fragment; without normals when `normals` is empty."""
    r0, r1, r2 = projected_weights(key, a, b, c, b0, b1, b2, orthographic)
    depth = (r0 * screen[a, 2] + r1 * screen[b, 2] + r2 * screen[c, 2]) / (r0 + r1 + r2)
    nx, ny, nz, shade = 0.0, 0.0, 0.0, 0.0
    if len(normals) > 0:
        nx, ny, nz, _ = mixed_normal(normals, a, b, c, r0, r1, r2, sign)
        shade = ambient + (1.0 - ambient) * max(0.0, nx * light[0] + ny * light[1] + nz * light[2])
    return depth, nx, ny, nz, shade


@nb.njit(cache=True, error_model="numpy", inline="always")
@typing.no_type_check
def pixel_fragment(screen, key, normals, a, b, c, px, py, light, ambient, orthographic):
    """Depth, normal (3) and shade of the face a, b, c at the pixel centre (px, py)."""
    b0, b1, b2, _, _, _, _, sign = pixel_weights(screen, a, b, c, px, py)
    return fragment(screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic)


@nb.njit(cache=True, error_model="numpy", inline="always")
@typing.no_type_check
def fragment_backward(
    screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic,
    g_depth, gx, gy, gz, g_shade, grad_screen, grad_normals,
):  # fmt: skip
    """Derivatives by b_0, b_1, b_2; those by depths and normals are added to the arrays.

    With r_i = b_i q_i:  depth = sum r_i z_i / sum r_i and n = +-sum r_i n_i / |...|, so that only r is to be derived.
    """
    r0, r1, r2 = projected_weights(key, a, b, c, b0, b1, b2, orthographic)
    g0, g1, g2, d0, d1, d2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if g_depth != 0.0:
        z0, z1, z2 = screen[a, 2], screen[b, 2], screen[c, 2]
        share = g_depth / (r0 + r1 + r2)
        depth = (r0 * z0 + r1 * z1 + r2 * z2) / (r0 + r1 + r2)
        g0, g1, g2 = share * (z0 - depth), share * (z1 - depth), share * (z2 - depth)
        d0, d1, d2 = share * r0, share * r1, share * r2
    if len(normals) > 0:
        nx, ny, nz, scale = mixed_normal(normals, a, b, c, r0, r1, r2, sign)
        if nx * light[0] + ny * light[1] + nz * light[2] > 0.0:
            lit = (1.0 - ambient) * g_shade
            gx, gy, gz = gx + lit * light[0], gy + lit * light[1], gz + lit * light[2]
        along = gx * nx + gy * ny + gz * nz
        gx, gy, gz = scale * (gx - along * nx), scale * (gy - along * ny), scale * (gz - along * nz)
        g0 += gx * normals[a, 0] + gy * normals[a, 1] + gz * normals[a, 2]
        g1 += gx * normals[b, 0] + gy * normals[b, 1] + gz * normals[b, 2]
        g2 += gx * normals[c, 0] + gy * normals[c, 1] + gz * normals[c, 2]
        add3(grad_normals, a, r0 * gx, r0 * gy, r0 * gz)
        add3(grad_normals, b, r1 * gx, r1 * gy, r1 * gz)
        add3(grad_normals, c, r2 * gx, r2 * gy, r2 * gz)
    if not orthographic:
        # q = -key = 1 / z, so that dq/dz = -q²
        g0, g1, g2 = -g0 * key[a], -g1 * key[b], -g2 * key[c]
        d0, d1, d2 = d0 + g0 * b0 * key[a], d1 + g1 * b1 * key[b], d2 + g2 * b2 * key[c]
    grad_screen[a, 2] += d0
    grad_screen[b, 2] += d1
    grad_screen[c, 2] += d2
    return g0, g1, g2


@nb.njit(cache=True, inline="always")
@typing.no_type_check
def add3(array, row, x, y, z):
    """Add x, y, z to a row of (N, 3)."""
    array[row, 0] += x
    array[row, 1] += y
    array[row, 2] += z


@nb.njit(cache=True, error_model="numpy", inline="always")
@typing.no_type_check
def pixel_backward(
    screen, key, normals, a, b, c, px, py, light, ambient, orthographic,
    g_depth, gx, gy, gz, g_shade, grad_screen, grad_normals,
):  # fmt: skip
    """Add the derivatives of what the pixel centre (px, py) shows of the face a, b, c."""
    b0, b1, b2, u0, v0, u1, v1, sign = pixel_weights(screen, a, b, c, px, py)
    h0, h1, h2 = fragment_backward(
        screen, key, normals, a, b, c, b0, b1, b2, sign, light, ambient, orthographic,
        g_depth, gx, gy, gz, g_shade, grad_screen, grad_normals,
    )  # fmt: skip
    along_x = (h0 - h2) * u0 + (h1 - h2) * u1
    along_y = (h0 - h2) * v0 + (h1 - h2) * v1
    grad_screen[a, 0] -= b0 * along_x
    grad_screen[a, 1] -= b0 * along_y
    grad_screen[b, 0] -= b1 * along_x
    grad_screen[b, 1] -= b1 * along_y
    grad_screen[c, 0] -= b2 * along_x
    grad_screen[c, 1] -= b2 * along_y


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def _shade_rows(
    screen,
    key,
    normals,
    faces,
    light,
    ambient,
    orthographic,
    start,
    end,
    face_id,
    mask,
    depth,
    normal,
    shaded,
):
    """Fill rows [start, end) of the pictures of one view."""
    for r in range(start, end):
        for col in range(face_id.shape[1]):
            face = face_id[r, col]
            cover, d, nx, ny, nz, lit = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            if face >= 0:
                a, b, c = corners_of(faces, face)
                d, nx, ny, nz, lit = pixel_fragment(
                    screen, key, normals, a, b, c, col + 0.5, r + 0.5, light, ambient, orthographic
                )
                cover = 1.0
            if mask.shape[0] > 0:
                mask[r, col] = cover
            if depth.shape[0] > 0:
                depth[r, col] = d
            if normal.shape[0] > 0:
                normal[r, col, 0] = nx
                normal[r, col, 1] = ny
                normal[r, col, 2] = nz
            if shaded.shape[0] > 0:
                shaded[r, col] = lit


@nb.njit(cache=True, parallel=True, error_model="numpy")
@typing.no_type_check
def shade(
    screen, keys, normals, faces, lights, ambient, orthographic, bands, face_id, mask, depth, normal, shaded
):
    """Fill the pictures (K, H, W) from the face seen at every pixel centre."""
    for task in nb.prange(face_id.shape[0] * bands):
        view, start, end = band_rows(task, bands, face_id.shape[1])
        _shade_rows(
            screen[view], keys[view], normals, faces, lights[view], ambient, orthographic, start, end,
            face_id[view], mask[view], depth[view], normal[view], shaded[view],
        )  # fmt: skip


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def shade_backward(
    screen, key, normals, faces, light, ambient, orthographic, start, end, face_id,
    g_mask, g_depth, g_normal, g_shaded, grad_screen, grad_normals,
):  # fmt: skip
    """Add the derivatives of rows [start, end) of `shade` in one view to grad_screen and grad_normals (V, 3)."""
    for r in range(start, end):
        for col in range(face_id.shape[1]):
            face = face_id[r, col]
            if face < 0:
                continue
            _, gd, gx, gy, gz, gs = read(g_mask, g_depth, g_normal, g_shaded, r, col)
            if gd == 0.0 and gx == 0.0 and gy == 0.0 and gz == 0.0 and gs == 0.0:
                continue
            a, b, c = corners_of(faces, face)
            pixel_backward(
                screen, key, normals, a, b, c, col + 0.5, r + 0.5, light, ambient, orthographic,
                gd, gx, gy, gz, gs, grad_screen, grad_normals,
            )  # fmt: skip


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def unproject(screen, rows, centre, nearest, orthographic, grad):
    """Turn the derivatives `grad` (V, 3) by column, row and depth into those by the world point, in place.

    rows (3, 3): the rotation, its first two rows in px; centre (2,): column and row of the optical axis. Nearer than
    `nearest` the projection divides by it instead of by the depth.
    """
    for v in range(len(grad)):
        x, y, z = grad[v, 0], grad[v, 1], grad[v, 2]
        if not orthographic:
            depth = max(screen[v, 2], nearest)
            x, y = x / depth, y / depth
            if screen[v, 2] >= nearest:
                z -= x * (screen[v, 0] - centre[0]) + y * (screen[v, 1] - centre[1])
        for axis in range(3):
            grad[v, axis] = x * rows[0, axis] + y * rows[1, axis] + z * rows[2, axis]


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
        a, b, c = corners_of(faces, f)
        x1, y1, z1, x2, y2, z2 = _sides(vertices, a, b, c)
        x, y, z = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
        add3(normals, a, x, y, z)
        add3(normals, b, x, y, z)
        add3(normals, c, x, y, z)
    for v in range(len(normals)):
        lengths[v] = np.sqrt(normals[v, 0] ** 2 + normals[v, 1] ** 2 + normals[v, 2] ** 2)
        for axis in range(3):
            normals[v, axis] = normals[v, axis] / lengths[v] if lengths[v] > 0.0 else 0.0


@nb.njit(cache=True, error_model="numpy")
@typing.no_type_check
def vertex_normals_backward(vertices, faces, normals, lengths, grads, by_vertices):
    """Add to by_vertices (V, 3) what the derivatives by the normals, slices (tasks, V, 3) of a sum, say.

    `grads` is overwritten.
    """
    grad = grads[0]
    for task in range(1, len(grads)):
        for v in range(len(normals)):
            add3(grad, v, grads[task, v, 0], grads[task, v, 1], grads[task, v, 2])
    for v in range(len(normals)):
        along = grad[v, 0] * normals[v, 0] + grad[v, 1] * normals[v, 1] + grad[v, 2] * normals[v, 2]
        for axis in range(3):
            across = grad[v, axis] - along * normals[v, axis]
            grad[v, axis] = across / lengths[v] if lengths[v] > 0.0 else 0.0
    for f in range(len(faces)):
        a, b, c = corners_of(faces, f)
        x1, y1, z1, x2, y2, z2 = _sides(vertices, a, b, c)
        x = grad[a, 0] + grad[b, 0] + grad[c, 0]
        y = grad[a, 1] + grad[b, 1] + grad[c, 1]
        z = grad[a, 2] + grad[b, 2] + grad[c, 2]
        # g . (e1 x e2) = e1 . (e2 x g) = e2 . (g x e1)
        bx, by, bz = y2 * z - z2 * y, z2 * x - x2 * z, x2 * y - y2 * x
        cx, cy, cz = y * z1 - z * y1, z * x1 - x * z1, x * y1 - y * x1
        add3(by_vertices, b, bx, by, bz)
        add3(by_vertices, c, cx, cy, cz)
        add3(by_vertices, a, -bx - cx, -by - cy, -bz - cz)

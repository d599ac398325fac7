"""`python tests/benchmarks/solid_table.py [PROFILE ...] [--only WORD] [--peers] [--slice]`: nasty meshes made solid.

Every mesh of `tests/nasty.py` goes through `solidify` with the wall of each profile, in a process of its own, and the
result is measured: manifold, faces through others, share of the surface at the wall, parts and genus, what has to stay
open or full, clearance to the body, deviation where it was thick, CPU seconds and memory. A refusal is a row with its
reason. `--peers` runs alpha wrap (pymeshlab), igl's offset surface and, where installed, pymeshfix on the same meshes.
`--slice` lets PrusaSlicer slice every result, filled: whether it does, without an empty layer (`!`), and by how much what
it lays, less supports, differs from the volume of the mesh.
"""

import argparse
import multiprocessing
import os
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
sys.path[:0] = [str(Path(__file__).parents[up]) for up in (1, 2)]

import igl
import numpy as np
import pymeshlab
from nasty import Nasty, all_nasty

from fabcraft.check.slicer import ask_slicer
from fabcraft.check.thickness import measure_thickness
from fabcraft.check.topology import inspect_topology
from fabcraft.errors import FabcraftError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.voxels import samples
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile, load_profile
from fabcraft.solid.thicken import SolidSettings, solidify

PROFILES = ("prusa-mk4", "form4", "sls-pa12")
CLEARANCE_MM = 0.5
Maker = Callable[[Nasty, float], Mesh]
HEAD = (
    f"{'mesh':24} {'faces':>6} {'sound':>5} {'wall%':>6} {'parts':>6} {'genus':>6} {'open':>4} {'p99':>5} {'max':>5} "
    f"{'clear':>6} {'cpu s':>6} {'MiB':>5}"
)


def ours(case: Nasty, wall_mm: float) -> Mesh:
    body = None if case.body is None else SurfaceDistance(case.body)
    return solidify(case.mesh, SolidSettings(wall_mm=wall_mm, clearance_mm=CLEARANCE_MM), body).mesh


def alpha_wrap(case: Nasty, wall_mm: float) -> Mesh:
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(np.array(case.mesh.vertices), np.array(case.mesh.faces)))
    meshes.generate_alpha_wrap(
        alpha=pymeshlab.PureValue(1.25 * wall_mm), offset=pymeshlab.PureValue(0.5 * wall_mm)
    )
    made = meshes.current_mesh()
    return Mesh(made.vertex_matrix(), made.face_matrix().astype(np.int32))


def igl_offset(case: Nasty, wall_mm: float) -> Mesh:
    cells = int(min(case.mesh.size_mm.max() / (wall_mm / 3), 250))
    points, faces, *_ = igl.offset_surface(
        np.array(case.mesh.vertices),
        np.array(case.mesh.faces, dtype=np.int64),
        0.5 * wall_mm,
        max(cells, 8),
        igl.SIGNED_DISTANCE_TYPE_UNSIGNED,
    )
    return Mesh(points, faces.astype(np.int32))


def mesh_fix(case: Nasty, wall_mm: float) -> Mesh:
    import pymeshfix

    made = pymeshfix.MeshFix(np.array(case.mesh.vertices), np.array(case.mesh.faces))
    made.repair()
    return Mesh(np.asarray(made.points, dtype=np.float64), np.asarray(made.faces, dtype=np.int32))


PEERS: dict[str, Maker] = {"alpha wrap": alpha_wrap, "igl offset": igl_offset, "pymeshfix": mesh_fix}


def row(
    name: str, build: Callable[[], Nasty], wall_mm: float, make: Maker, slicing: PrinterProfile | None = None
) -> str:
    """One line; `!` behind a figure that misses its aim.  slicing : for which printer the result is sliced too."""
    case = build()
    floor = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.process_time()
    try:
        mesh = make(case, wall_mm)
    except FabcraftError as error:
        return f"{name:24} {len(case.mesh.faces):6d} refused: {error}"
    seconds = time.process_time() - start
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - floor) / 1024
    state = inspect_topology(mesh)
    sound = state.solid and state.self_intersections == 0 and state.manifold_status == "NoError"
    share = 100 * measure_thickness(mesh, 0.97 * wall_mm).ok_share if state.solid else float("nan")
    parts, genus = state.parts - state.cavities, state.genus
    inside = SurfaceDistance(mesh).inside
    kept = not (case.empty and inside(np.array(case.empty)).any())
    kept &= not case.full or bool(inside(np.array(case.full)).all())
    middle, most = deviation(case.truth, mesh, wall_mm) if case.truth else (0.0, 0.0)
    clear = 0.0
    if case.body is not None:
        clear = float(SurfaceDistance(case.body).signed(samples(mesh.corners, 1.0)[0]).min())

    def flag(text: str, good: bool) -> str:
        return text + (" " if good else "!")

    return (
        f"{name:24} {len(case.mesh.faces):6d} "
        f"{flag('yes' if sound else 'NO', sound):>5} {flag(f'{share:.2f}', share >= 99.5):>7}"
        f"{flag(f'{parts}/{_or(case.parts)}', case.parts in (None, parts)):>7}"
        f"{flag(f'{_or(genus)}/{_or(case.genus)}', case.genus in (None, genus)):>8}"
        f"{flag('yes' if kept else 'NO', kept):>5}"
        f"{flag(f'{middle:.3f}', middle <= 0.05):>7}{flag(f'{most:.3f}', most <= 0.1):>7}"
        f"{flag(f'{clear:.3f}', case.body is None or clear >= CLEARANCE_MM - 0.02):>7}"
        f"{seconds:7.1f}{memory:6.0f}" + ("" if slicing is None else f"  {sliced(mesh, slicing)}")
    )


def sliced(mesh: Mesh, profile: PrinterProfile) -> str:
    """What PrusaSlicer makes of it at full infill: laid over volume, or why not."""
    mesh = mesh.with_vertices(mesh.vertices - mesh.bounds[0])
    roomy = replace(profile, build_mm=tuple(np.maximum(profile.build_mm, mesh.size_mm + 20.0)))
    # resin's supports cannot be told from the part; what stands on a corner is not begun without any
    answer = ask_slicer(mesh, roomy, supports=profile.process == "fdm", infill_percent=100)
    if not answer.sliced:
        return f"not sliced! {answer.error[:60]}"
    if answer.empty_layers_mm:
        return f"{len(answer.empty_layers_mm)} empty layers!"
    laid = answer.material_mm3 if answer.laid_mm3 is None else answer.laid_mm3 - (answer.support_mm3 or 0.0)
    off = 100.0 * ((laid or 0.0) / mesh.volume_mm3 - 1.0)
    return f"{off:+.1f} %{'' if abs(off) <= 5.0 else '!'}"


def deviation(truth: Mesh, made: Mesh, wall_mm: float) -> tuple[float, float]:
    """How far the result is from the truth where that is clearly thicker than the wall: p99 and most, mm."""
    thickness = measure_thickness(truth, 1.3 * wall_mm)
    thick = ~thickness.thin
    if not thick.any():
        return 0.0, 0.0
    off = SurfaceDistance(made).closest(thickness.points[thick]).distances
    return float(np.percentile(off, 99)), float(off.max())


def _or(value: int | None) -> str:
    return "-" if value is None else str(value)


def _answer(pipe, *arguments) -> None:
    try:
        pipe.send(row(*arguments))
    except Exception as error:
        pipe.send(f"{arguments[0]:24} FAILED: {type(error).__name__}: {str(error)[:120]}")


def apart(seconds: float, name: str, *arguments) -> str:
    """The row from a process of its own, so that its memory is its own and it can be ended."""
    here, there = multiprocessing.get_context("fork").Pipe()
    process = multiprocessing.get_context("fork").Process(target=_answer, args=(there, name, *arguments))
    process.start()
    text = here.recv() if here.poll(seconds) else f"{name:24} FAILED: not done in {seconds:g} s"
    process.terminate()
    process.join()
    return text


def table(profile: PrinterProfile, only: list[str], peers: bool, slicing: bool, seconds: float) -> None:
    """The table of one profile, row by row as they come."""
    slicer = profile if slicing and profile.process in ("fdm", "sla") else None
    print(f"\n{profile.name}: wall {profile.wall_mm:g} mm\n{HEAD}{'  slicer' if slicer else ''}", flush=True)
    for name, build in all_nasty().items():
        if not only or any(word in name for word in only):
            print(apart(seconds, name, build, profile.wall_mm, ours, slicer), flush=True)
            for peer, make in PEERS.items() if peers else ():
                print(apart(seconds, f"  {peer}", build, profile.wall_mm, make), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("profiles", nargs="*", default=PROFILES)
    parser.add_argument("--only", nargs="*", default=[], help="names that hold one of these words")
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--slice", action="store_true")
    parser.add_argument("--seconds", type=float, default=120.0, help="most time for one mesh")
    given = parser.parse_args()
    for wanted in given.profiles:
        table(load_profile(wanted), given.only, given.peers, given.slice, given.seconds)

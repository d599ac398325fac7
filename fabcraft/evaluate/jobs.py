"""Cells computed by several processes at the same time: the same cells, in the same order, as by one.

A process may be ended from outside, as for the memory that it asks for: that costs the cell that it computed, if anything.
"""

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from threading import Thread

from fabcraft.evaluate.cells import Cell, Options, cell_of
from fabcraft.evaluate.suite import Design

Compute = Callable[[str, Design, Options], Cell]


def in_processes(
    asked: Sequence[tuple[str, Design]], options: Options, jobs: int, compute: Compute = cell_of
) -> Iterator[Cell]:
    """The cells in the order asked for, by `jobs` processes.  Ctrl-C ends them at once; what they had finished is kept."""
    done = 0
    while done < len(asked):
        rest = asked[done:]
        try:
            with _processes(jobs) as pool:
                # the first cell of a design makes its guidance mesh, which the others read
                first = {design.name.partition("@")[0]: (method, design) for method, design in reversed(rest)}
                list(pool.map(compute, *zip(*first.values(), strict=True), [options] * len(first)))
                for cell in pool.map(compute, *zip(*rest, strict=True), [options] * len(rest)):
                    yield cell
                    done += 1
        except (
            BrokenProcessPool
        ):  # by any of the cells under way; what the others had finished is found again
            yield _alone(*asked[done], options, compute)
            done += 1


def _alone(method: str, design: Design, options: Options, compute: Compute) -> Cell:
    """A cell by a process of its own, or what became of that."""
    try:
        with _processes(1) as pool:
            return pool.submit(compute, method, design, options).result()
    except BrokenProcessPool:
        return Cell(
            method=method,
            design=design.name,
            title=design.title,
            key="",
            folder="",
            metrics={},
            seconds=0.0,
            error="the process that computed it was ended, perhaps as there was too little memory",
            next_step=f"Run it again with fewer --jobs, or alone: --only {method}/{design.name}.",
        )


def _begin() -> None:
    """What a new process does first."""
    warnings.simplefilter("ignore")  # what libraries say to programmers

    def follow() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)  # nobody is left to hand the cell to; it would wait for the next one for ever

    Thread(target=follow, daemon=True).start()


@contextmanager
def _processes(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes do not outlive it, whatever they are at."""
    before = set(active_children())
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            ended = set(active_children()) - before
            for child in ended:
                child.terminate()
            for child in ended:
                child.join()
            raise

"""The loop: Adam on restricted Jacobians and a translation, through a Poisson solve, over a sum of terms.

It knows no term by name. Variables: X (F, D, 2), added to the rest mesh's own restriction W (so X = 0 is the rest mesh
exactly), and t (D,), since a Poisson solve says nothing about where the object sits. A step whose energy or gradient is
not finite is skipped and halves the learning rate; five in a row stop the run. Ctrl-C stops it and keeps the best so far.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from fabcraft.fit.losses import Term
from fabcraft.geometry.poisson import PoissonSystem


class Stop(Enum):
    """Why a run ended; the value is the message."""

    STEPS = "all steps done"
    STILL = "nothing moved any more"
    INTERRUPTED = "interrupted: the best so far is kept"
    NOT_FINITE = "the energy stopped being a finite number; lower the learning rate or the weights"


@dataclass(frozen=True)
class Descent:
    """How a stage descends."""

    steps: int
    """Number of Adam steps."""
    learning_rate: float
    """For the Jacobians (no unit), at the start; it falls to `final_share` of itself along a cosine."""
    translation_rate: float
    """For the translation, in the optimiser's unit."""
    final_share: float = 0.1
    """Learning rate at the end over that at the start."""
    still: float = 2e-5
    """Stop when no vertex moved farther than this in 20 steps, optimiser's unit (2e-5 is 2 µm on a 200 mm mask)."""


@dataclass(frozen=True, eq=False)
class State:
    """What a term sees at a step."""

    system: PoissonSystem
    positions: Float[Tensor, "V D"]
    """Vertices now, optimiser's frame."""
    restricted: Float[Tensor, "F D 2"]
    """J W of every face now."""
    step: int


@dataclass(frozen=True, eq=False)
class Variables:
    """Where a run stands: the unknowns and Adam's two moments of each, so that another run can go on from here."""

    offset: Float[Tensor, "F D 2"]
    translation: Float[Tensor, " D"]
    moments: tuple[Tensor, Tensor, Tensor, Tensor] | None = None
    """First and second moment of the offset, then of the translation."""
    step: int = 0

    @staticmethod
    def rest(faces: int, dimension: int) -> "Variables":
        """The rest mesh, where it is."""
        return Variables(torch.zeros(faces, dimension, 2), torch.zeros(dimension))


@dataclass(frozen=True, eq=False)
class Descended:
    """The outcome of a stage."""

    positions: Float64[np.ndarray, "V D"]
    variables: Variables
    history: dict[str, list[float]] = field(repr=False)
    """Weighted value of every term at every step, and `total`."""
    stopped: Stop


def rest_restriction(system: PoissonSystem, dimension: int) -> Float[Tensor, "F D 2"]:
    """W itself: the restriction of the map that does nothing."""
    return torch.from_numpy(np.ascontiguousarray(system.frames[:, :dimension, :])).float()


def descend(
    system: PoissonSystem,
    terms: Sequence[Term],
    descent: Descent,
    start: Variables,
    watch: Callable[[int, dict[str, float], Tensor], None] | None = None,
) -> Descended:
    """Lower Σ weight·term for `descent.steps` steps; `watch(step, values, positions)` is called at every step."""
    base = rest_restriction(system, len(start.translation))
    offset = start.offset.clone().requires_grad_(True)
    translation = start.translation.clone().requires_grad_(True)
    optimiser = torch.optim.Adam(
        [
            {"params": [offset], "lr": descent.learning_rate},
            {"params": [translation], "lr": descent.translation_rate},
        ]
    )
    _restore(optimiser, offset, translation, start)
    history: dict[str, list[float]] = {name: [] for name in [*(term.name for term in terms), "total"]}
    best, best_positions = math.inf, None
    failures, slowed, marked, stopped = 0, 1.0, None, Stop.STEPS
    try:
        for step in range(descent.steps):
            share = 0.5 * (1.0 + math.cos(math.pi * step / max(descent.steps, 1)))
            factor = slowed * (descent.final_share + (1.0 - descent.final_share) * share)
            optimiser.param_groups[0]["lr"] = descent.learning_rate * factor
            optimiser.param_groups[1]["lr"] = descent.translation_rate * factor
            optimiser.zero_grad(set_to_none=True)
            restricted = base + offset
            positions = system.vertices_of_restricted(restricted) + translation
            state = State(system, positions, restricted, step)
            values = {term.name: term.weight * term.function(state) for term in terms}
            total = torch.stack(list(values.values())).sum()
            total.backward()
            if not (torch.isfinite(total) and _finite(offset.grad)):
                failures, slowed = failures + 1, slowed * 0.5
                if failures == 5:
                    stopped = Stop.NOT_FINITE
                    break
                continue
            failures = 0
            torch.nn.utils.clip_grad_norm_([offset], 1.0)
            numbers = {name: float(value.detach()) for name, value in values.items()}
            for name, value in numbers.items():
                history[name].append(value)
            history["total"].append(float(total.detach()))
            now = positions.detach()
            if history["total"][-1] < best:
                best, best_positions = history["total"][-1], now
            if watch is not None:
                watch(step, numbers, now)
            optimiser.step()
            if step % 20 == 19:
                if marked is not None and float((now - marked).abs().max()) < descent.still:
                    stopped = Stop.STILL
                    break
                marked = now
    except KeyboardInterrupt:
        stopped = Stop.INTERRUPTED
    with torch.no_grad():
        positions = system.vertices_of_restricted(base + offset) + translation
    if stopped in (Stop.INTERRUPTED, Stop.NOT_FINITE) and best_positions is not None:
        positions = best_positions
    return Descended(
        positions.detach().double().numpy(),
        _variables(optimiser, offset, translation, start),
        history,
        stopped,
    )


def _finite(gradient: Tensor | None) -> bool:
    return gradient is None or bool(torch.isfinite(gradient).all())


def _restore(optimiser: torch.optim.Adam, offset: Tensor, translation: Tensor, start: Variables) -> None:
    if start.moments is None:
        return
    for parameter, first, second in ((offset, *start.moments[:2]), (translation, *start.moments[2:])):
        optimiser.state[parameter] = {
            "step": torch.tensor(float(start.step)),
            "exp_avg": first.clone(),
            "exp_avg_sq": second.clone(),
        }


def _variables(
    optimiser: torch.optim.Adam, offset: Tensor, translation: Tensor, start: Variables
) -> Variables:
    if not optimiser.state.get(offset) or not optimiser.state.get(translation):
        return start
    first, second = optimiser.state[offset], optimiser.state[translation]
    moments = (first["exp_avg"], first["exp_avg_sq"], second["exp_avg"], second["exp_avg_sq"])
    return Variables(
        offset.detach().clone(),
        translation.detach().clone(),
        (moments[0].clone(), moments[1].clone(), moments[2].clone(), moments[3].clone()),
        int(first["step"]),
    )

"""The loop: Adam on restricted Jacobians and a translation, through a Poisson solve, over a sum of terms.

It knows no term by name. Variables: X (F, D, 2), added to the rest mesh's own restriction W (so X = 0 is the rest mesh
exactly), and t (D,), since a Poisson solve says nothing about where the object sits. A step after which energy or
gradient is not finite is halved, and so is the learning rate; `PATIENCE` times in a row stop the run. Ctrl-C stops it
and keeps the best so far, where energies of different steps are compared without their paces, so that a term that is
eased in does not count as worse.

What is too large for one graph comes as *chunks*: each chunk's gradient is taken to the positions alone and added up there,
and then goes once through the Poisson solve, so that memory does not grow with the number of chunks.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from fabcraft.fit.adam import adam_step
from fabcraft.fit.losses import Term
from fabcraft.geometry.poisson import PoissonSystem

PATIENCE = 8
"""Halvings in a row before a run gives up: by then the last step is under a hundredth of itself."""


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
    clip: float | None = 1.0
    """Longest gradient of the Jacobians, as one vector; None leaves it as it is."""
    betas: tuple[float, float] = (0.9, 0.999)
    """Adam's memory of the gradient and of its square, a step. Early gradients are the largest: where the square is
    remembered long, late features grow slowly."""
    before: int = 0
    """Steps that came before in a run of several stages; `State.step` counts on from here."""
    whole: int | None = None
    """Steps of all stages together, over which the cosine runs; None for a run of one stage."""

    def share_at(self, step: int) -> float:
        """Learning rate over that at the start, at `step` of this stage."""
        cosine = 0.5 * (1.0 + math.cos(math.pi * (self.before + step) / max(self.whole or self.steps, 1)))
        return self.final_share + (1.0 - self.final_share) * cosine


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
    def rest(faces: int, dimension: int, device: torch.device | str = "cpu") -> "Variables":
        """The rest mesh, where it is; a run goes on on the device of its variables."""
        return Variables(
            torch.zeros(faces, dimension, 2, device=device), torch.zeros(dimension, device=device)
        )


@dataclass(frozen=True, eq=False)
class Descended:
    """The outcome of a stage."""

    positions: Float64[np.ndarray, "V D"]
    variables: Variables
    history: dict[str, list[float]] = field(repr=False)
    """Weighted value of every term at every step, and `total`."""
    stopped: Stop


def rest_restriction(
    system: PoissonSystem, dimension: int, device: torch.device | str = "cpu"
) -> Float[Tensor, "F D 2"]:
    """W itself: the restriction of the map that does nothing."""
    return torch.from_numpy(np.ascontiguousarray(system.frames[:, :dimension, :])).float().to(device)


@dataclass(frozen=True, eq=False)
class Ways:
    """What a run may do beyond summing terms; the default is nothing."""

    chunks: Callable[[State], Iterator[Mapping[str, Tensor]]] | None = None
    """Weighted values by name, chunk by chunk, of a state whose positions are a leaf: their gradients are added up there.
    A name may come in several chunks; its values are summed."""
    pace: Callable[[str, int], float] | None = None
    """Factor of a term, by its name, at a step."""
    admit: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]] | None = None
    """What of offset and translation counts, e.g. their symmetric part; differentiable."""


def descend(
    system: PoissonSystem,
    terms: Sequence[Term],
    descent: Descent,
    start: Variables,
    watch: Callable[[int, dict[str, float], Tensor], None] | None = None,
    ways: Ways | None = None,
) -> Descended:
    """Lower Σ weight·term for `descent.steps` steps; `watch(step, values, positions)` is called at every step."""
    run = _Run(system, terms, descent, start, ways or Ways())
    failures, slowed, marked, stopped = 0, 1.0, None, Stop.STEPS
    try:
        for step in range(descent.steps):
            run.pace_rates(slowed * descent.share_at(step))
            positions, values, judged = run.energy(descent.before + step)
            if not run.finite(values):
                failures, slowed = failures + 1, slowed * 0.5
                if failures == PATIENCE:
                    stopped = Stop.NOT_FINITE
                    break
                run.halve_step()
                continue
            failures = 0
            run.note(positions, values, judged)
            if watch is not None:
                watch(descent.before + step, values, positions)
            run.step()
            if step % 20 == 19:
                if marked is not None and float((positions - marked).abs().max()) < descent.still:
                    stopped = Stop.STILL
                    break
                marked = positions
    except KeyboardInterrupt:
        stopped = Stop.INTERRUPTED
    return run.outcome(stopped)


class _Run:
    """The unknowns of a run, their optimiser and what is remembered along the way."""

    def __init__(
        self, system: PoissonSystem, terms: Sequence[Term], descent: Descent, start: Variables, ways: Ways
    ) -> None:
        self.system, self.terms, self.descent, self.ways = system, terms, descent, ways
        self.base = rest_restriction(system, len(start.translation), start.offset.device)
        self.offset = start.offset.clone().requires_grad_(True)
        self.translation = start.translation.clone().requires_grad_(True)
        unknowns = (self.offset, self.offset, self.translation, self.translation)
        self.moments = [one.clone() for one in start.moments or map(torch.zeros_like, unknowns)]
        self.stepped = start.step if start.moments is not None else 0
        self.rates = (descent.learning_rate, descent.translation_rate)
        self.history: dict[str, list[float]] = {
            name: [] for name in [*(term.name for term in terms), "total"]
        }
        self.last: tuple[Tensor, Tensor] | None = None
        self.best = math.inf
        self.best_positions: Tensor | None = None

    def step(self) -> None:
        """One step of Adam; where it started is remembered."""
        self.last = self.offset.detach().clone(), self.translation.detach().clone()
        self.stepped += 1
        first, second, shift_first, shift_second = self.moments
        unknowns = ((self.offset, first, second), (self.translation, shift_first, shift_second))
        with torch.no_grad():
            for (unknown, *moments), rate in zip(unknowns, self.rates, strict=True):
                if unknown.grad is not None:
                    mean, square = moments
                    adam_step(unknown, unknown.grad, mean, square, self.stepped, rate, self.descent.betas)

    def halve_step(self) -> None:
        """Go half the way back to where the last step started: there the energy was a number."""
        if self.last is not None:
            with torch.no_grad():
                self.offset.lerp_(self.last[0], 0.5)
                self.translation.lerp_(self.last[1], 0.5)

    def pace_rates(self, factor: float) -> None:
        """Set the learning rates of the step to come, and forget the gradients of the last."""
        self.rates = (self.descent.learning_rate * factor, self.descent.translation_rate * factor)
        self.offset.grad = self.translation.grad = None

    def placed(self) -> tuple[Tensor, Tensor]:
        """J W of every face and the vertices, as the unknowns have it."""
        offset, translation = self.offset, self.translation
        if self.ways.admit is not None:
            offset, translation = self.ways.admit(offset, translation)
        restricted = self.base + offset
        return restricted, self.system.vertices_of_restricted(restricted) + translation

    def energy(self, step: int) -> tuple[Tensor, dict[str, float], float]:
        """Gradients at the unknowns; returns the vertices, every term's value, and the energy without paces."""
        pace = self.ways.pace or (lambda name, step: 1.0)
        restricted, positions = self.placed()
        state = State(self.system, positions, restricted, step)
        values = {term.name: term.weight * term.function(state) for term in self.terms}
        roots = [pace(name, step) * value for name, value in values.items()]
        plain = _numbers(values.values())
        judged = sum(plain)
        numbers = {name: pace(name, step) * number for name, number in zip(values, plain, strict=True)}
        leaf = positions.detach()
        if self.ways.chunks is not None:
            leaf.requires_grad_(True)
            for chunk in self.ways.chunks(State(self.system, leaf, restricted.detach(), step)):
                parts = [pace(name, step) * value for name, value in chunk.items()]
                plain = _numbers(chunk.values())
                judged += sum(plain)
                for name, number in zip(chunk, plain, strict=True):
                    numbers[name] = numbers.get(name, 0.0) + pace(name, step) * number
                summed = torch.stack(parts).sum() if parts else leaf.new_zeros(())
                if summed.requires_grad:
                    summed.backward()
        total = torch.stack(roots).sum() if roots else positions.new_zeros(())
        if leaf.grad is not None:
            total = total + (positions * leaf.grad).sum()
        if total.requires_grad:
            total.backward()
        return leaf.detach(), numbers, judged

    def finite(self, values: Mapping[str, float]) -> bool:
        """Whether the energy and both gradients are numbers."""
        gradients = (self.offset.grad, self.translation.grad)
        return all(math.isfinite(value) for value in values.values()) and all(map(_finite, gradients))

    def note(self, positions: Tensor, values: Mapping[str, float], judged: float) -> None:
        """Clip the gradient, write down the step and remember it if it is the best."""
        if self.descent.clip is not None and self.offset.grad is not None:
            torch.nn.utils.clip_grad_norm_([self.offset], self.descent.clip)
        done = len(self.history["total"])
        for name in {**self.history, **values}:
            if name != "total":
                self.history.setdefault(name, [0.0] * done).append(values.get(name, 0.0))
        self.history["total"].append(sum(values.values()))
        if judged < self.best:
            self.best, self.best_positions = judged, positions

    def outcome(self, stopped: Stop) -> Descended:
        """What the run leaves behind."""
        with torch.no_grad():
            positions = self.placed()[1]
        if stopped in (Stop.INTERRUPTED, Stop.NOT_FINITE) and self.best_positions is not None:
            positions = self.best_positions
        first, second, *shift = self.moments
        variables = Variables(
            self.offset.detach(), self.translation.detach(), (first, second, shift[0], shift[1]), self.stepped
        )
        return Descended(positions.detach().double().cpu().numpy(), variables, self.history, stopped)


def _numbers(values: Iterable[Tensor]) -> list[float]:
    """0-d tensors as numbers, fetched from their device together."""
    found = [value.detach() for value in values]
    return torch.stack(found).tolist() if found else []


def _finite(gradient: Tensor | None) -> bool:
    return gradient is None or bool(torch.isfinite(gradient).all())

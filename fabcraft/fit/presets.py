"""`DeformSettings`: how the general deformation runs; presets, the paper's baselines and its ablation, as settings alone.

Weights hold in the optimiser's frame (longest template side = 2). Schedules, as shares of the run: the body's terms are
eased in over the first 20 %, the shape's own stiffness is loosened after 55 %, and the last 15 % are for the fit, with the
guidance turned down and the body's terms turned up. TextDeformer's 0.5 on the mean over nine entries is 0.056 here.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

from fabcraft.errors import InputError

MOST_STEPS = 100_000
"""Of a run."""


@dataclass(frozen=True)
class DeformWeights:
    """Weights of the terms that are not guidance; 0 switches one off."""

    contact: float = 30.0
    """Contacts meet their place. At 100 heart-shaped glasses lay no nearer to the nose, and were less like their hearts."""
    penetration: float = 1e4
    """Hinge on the clearance."""
    jacobian: float = 0.017
    """Area mean of |J W − W|²: the map stays near doing nothing."""
    locked: float = 500.0
    """The locked faces stay on the surface that they were built on, along which they may spread. A bangle
    overlapped its guidance by .968 at 300 and .965 at 1000; what is left is mended exactly after the loop."""
    collapse: float = 10.0
    """No collapsed, folded or torn faces."""
    normal: float = 0.5
    """Normals of neighbouring faces agree."""
    edge: float = 0.1
    """Edges stretch evenly."""
    smoothness: float = 0.02
    """Neighbouring faces are mapped alike."""


@dataclass(frozen=True)
class DeformSettings:
    """How a deformation runs."""

    steps: int = 800
    """Adam steps."""
    learning_rate: float = 5e-3
    """For the Jacobians, at the start."""
    translation_rate: float = 2e-3
    """For the translation, in the optimiser's frame."""
    final_share: float = 0.1
    """Learning rate at the end over that at the start; 1 keeps it constant."""
    clip: float | None = 1.0
    """Longest gradient of the Jacobians; none leaves it as it is."""
    square_memory: float = 0.95
    """Adam's memory of squared gradients, a step. With the usual 0.999 the large early ones slow down what grows late:
    long horns ended three times as far from their target."""
    views: int = 12
    """Pictures a step."""
    bank: int = 48
    """Fixed cameras that the pictures of a step are drawn from; targets can be computed once for each."""
    chunk: int = 4
    """Pictures held in memory at a time; changes nothing but memory and time."""
    pixels: int = 256
    """Side of a picture."""
    fov_deg: float = 45.0
    """Opening angle of a picture."""
    paired_views: bool = False
    """Cameras in pairs of neighbours at most 15 degrees apart, for guidance that compares views."""
    seed: int = 0
    """Of everything random."""
    device: Literal["cpu", "cuda", "auto"] = "auto"
    """Where to compute; auto is a CUDA graphics card where there is one."""
    clearance_mm: float = 0.2
    """Least distance of the object's surface to the skin."""
    weights: DeformWeights = field(default_factory=DeformWeights)
    ramp_until: float = 0.2
    """Share of the run over which the body's terms are eased in, from a tenth."""
    loosen_after: float = 0.55
    """Share of the run after which the Jacobian term counts less; 1 never."""
    loosened: float = 1.0 / 6.0
    """How much it counts then."""
    fit_after: float = 0.85
    """Share of the run after which the fit has priority; 1 never."""
    guidance_then: float = 0.1
    """How much the guidance counts then; 0 switches it off and saves the pictures."""
    body_then: float = 10.0
    """How much the body's terms count then."""
    locked_falloff: float = 0.02
    """How far along the surface the lock of the locked faces fades away, over the longest side."""
    remesh_every: int = 100
    """Steps between looks at the stretch, up to the fit phase; 0 never changes the triangles."""
    remesh_stretch: float = 1.5
    """Edges that have grown more than this are split."""
    carry_moments: bool = False
    """Carry Adam's moments over when refining, instead of starting afresh. Afresh was nearer to long horns (0.18 and
    0.23 mm at a memory of 0.95, 0.19 and 1.0 mm at 0.999)."""
    link_parts: bool = True
    """Tie the parts of a template of several pieces to each other, softly."""
    settle: bool = True
    """After the loop, bring locked faces back, settle and push out, so that seat and clearance are promises."""
    wall_mm: float = 0.0
    """What settling keeps between the side that looks at the body and the one behind it; 0: not looked at."""

    def __post_init__(self) -> None:
        counts = {"steps": self.steps, "views": self.views, "bank": self.bank, "chunk": self.chunk}
        for name, value in counts.items():
            if not (0 if name == "steps" else 1) <= value <= MOST_STEPS:
                raise InputError(f"{name} = {value} was asked", "Choose 1 to 100000 (steps may be 0).")
        if self.views > self.bank:
            raise InputError(
                f"{self.views} views a step from a bank of {self.bank} were asked", "Give a larger bank."
            )
        if not 16 <= self.pixels <= 2048:
            raise InputError(f"pictures of {self.pixels} pixels were asked", "Choose 16 to 2048.")
        shares = (self.ramp_until, self.loosen_after, self.fit_after)
        if not all(0.0 <= share <= 1.0 for share in shares):
            raise InputError(f"the schedule has shares {shares} of the run", "Choose shares within 0..1.")

    def pace(self, name: str, step: int) -> float:
        """Factor of a term at a step of the run; every name that is not the shape's or the body's is guidance."""
        share = step / max(self.steps, 1)
        fitting = share >= self.fit_after
        if name in ("contact", "penetration"):
            eased = 1.0 if share >= self.ramp_until else 0.1 + 0.9 * share / self.ramp_until
            return eased * (self.body_then if fitting else 1.0)
        if name == "jacobian":
            return self.loosened if share >= self.loosen_after else 1.0
        if name in ("locked", "collapse", "normal", "edge", "smoothness"):
            return 1.0
        return self.guidance_then if fitting else 1.0


_LINEAGE = DeformWeights(normal=1.0, edge=1.0, smoothness=0.0)
PRESETS: Mapping[str, DeformSettings] = MappingProxyType(
    {
        "paper": DeformSettings(
            steps=1800,
            learning_rate=2.5e-3,
            translation_rate=1e-3,
            final_share=1.0,
            clip=None,
            square_memory=0.999,
            remesh_every=0,
            views=24,
            bank=96,
            pixels=512,
            clearance_mm=0.0,
            weights=_LINEAGE,
        ),
        "standard": DeformSettings(),
        "draft": DeformSettings(
            steps=300,
            learning_rate=1e-2,
            translation_rate=4e-3,
            views=4,
            bank=16,
            pixels=128,
            weights=DeformWeights(jacobian=0.02),
            loosened=0.25,
            remesh_every=40,
        ),
    }
)
"""`paper`: the constants of the papers it is built on; `standard`: many cores; `draft`: two cores, no encoder."""


def for_text(settings: DeformSettings) -> DeformSettings:
    """The settings for a text alone: longer, stiffer to the end, with views in pairs of neighbours."""
    paper = settings.final_share == 1.0
    weights = replace(settings.weights, jacobian=0.056)
    if paper:
        weights = replace(weights, normal=0.0, edge=0.0)
    return replace(
        settings,
        steps=2500 if paper else settings.steps * 3 // 2,
        views=settings.views + settings.views % 2,
        bank=settings.bank + settings.bank % 2,
        weights=weights,
        paired_views=True,
        loosened=1.0,
    )


@dataclass(frozen=True)
class Baseline:
    """A row of the comparison: which mesh is deformed, what guides it, and how."""

    name: str
    base: Literal["template", "guidance"]
    """The mesh to deform: the placed template, or the aligned guidance mesh."""
    guided: Literal["nothing", "text", "picture"]
    """Which guidance to hand to `deform`; picture stands for a guidance mesh and its pictures."""
    body: bool
    """Whether the body counts: hand body and contacts to `deform` only then."""
    settings: DeformSettings
    locked: bool = False
    """Whether the template's faces that meet the body keep their shape: the paper has no such thing."""


BASELINES: Mapping[
    str, tuple[Literal["template", "guidance"], Literal["nothing", "text", "picture"], bool]
] = MappingProxyType(
    {
        "template": ("template", "nothing", False),
        "guidance": ("guidance", "nothing", False),
        "guidance+body": ("guidance", "nothing", True),
        "no-body-loss": ("template", "picture", False),
        "ours": ("template", "picture", True),
        "textdeformer": ("template", "text", False),
        "body-aware-textdeformer": ("template", "text", True),
    }
)
"""The rows of the paper's table: base mesh, guidance, body."""
LOSSES = ("none", "contact", "penetration", "both")
"""The paper's ablation of the body's terms; as baselines `loss-none` and so on: "ours" with these alone, not settled."""


def baseline(name: str, settings: DeformSettings | None = None) -> Baseline:
    """A row of the comparison by name; the two TextDeformers run on the paper's constants.

    Only "ours" locks the faces that meet the body, and is settled and pushed out: the others are measured as
    their loop leaves them.
    Raises `InputError` for an unknown name.
    """
    chosen = settings or PRESETS["standard"]
    kept = name.removeprefix("loss-")
    if kept in LOSSES and name != kept:
        return Baseline(name, "template", "picture", True, ablations(chosen)[kept])
    if name not in BASELINES:
        known = (*BASELINES, *(f"loss-{one}" for one in LOSSES))
        raise InputError(f"no baseline '{name}'", f"Choose one of {', '.join(known)}.")
    base, guided, body = BASELINES[name]
    if guided == "text":
        chosen = replace(for_text(PRESETS["paper"]), seed=chosen.seed, chunk=chosen.chunk)
    ours = name == "ours"
    if name in ("template", "guidance"):
        chosen = replace(chosen, steps=0)
    if not body:
        weights = replace(chosen.weights, contact=0.0, penetration=0.0)
        chosen = replace(chosen, weights=weights, fit_after=1.0)
    return Baseline(name, base, guided, body, replace(chosen, settle=ours and chosen.settle), ours)


def ablations(settings: DeformSettings) -> dict[str, DeformSettings]:
    """The paper's ablation of the body's terms: none, contact, penetration, both; what the loop alone achieves."""
    kept = {
        "none": (0.0, 0.0),
        "contact": (settings.weights.contact, 0.0),
        "penetration": (0.0, settings.weights.penetration),
        "both": (settings.weights.contact, settings.weights.penetration),
    }
    return {
        name: replace(
            settings,
            settle=False,
            weights=replace(settings.weights, contact=contact, penetration=penetration),
        )
        for name, (contact, penetration) in kept.items()
    }

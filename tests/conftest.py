"""One whole run of `fabcraft make`, made once and looked at by many tests."""

import os

os.environ.setdefault(
    "OMP_WAIT_POLICY", "PASSIVE"
)  # before torch: spinning threads would wait for each other

if "PYTEST_XDIST_WORKER" in os.environ:  # workers side by side share the cores: one thread each
    os.environ.setdefault("OMP_NUM_THREADS", "1")

os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # before cuBLAS: sums in a fixed order

import contextlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from fabcraft.pipeline import Made

EXAMPLES = Path(__file__).parents[1] / "examples"


@dataclass(frozen=True)
class Run:
    """What a run left behind."""

    code: int
    folder: Path
    report: dict
    """What --json printed."""
    progress: str
    """What stderr said."""
    made: "Made"


_CAT = ("tests/test_outputs.py", "tests/test_pipeline.py")
"""Files that look at the cat mask: one worker makes it for them all."""
_LONGEST = (
    *_CAT,
    *(f"tests/test_{name}.py" for name in ("readme", "body_scan", "guidance_target", "cli", "fitting_room")),
    *(
        f"tests/test_{name}.py"
        for name in ("body_scan_settings", "evaluate_run", "solid_thicken", "road_motif")
    ),
)
"""Files that take longest, which begin first: one that began last would keep one worker busy and the others idle."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, all others as they are."""
    place = {file: at for at, file in enumerate(_LONGEST)}
    items.sort(key=lambda item: place.get(item.nodeid.split("::")[0], len(place)))


def pytest_xdist_make_scheduler(config, log):
    """As --dist loadfile, in the order of collection, with the files of the cat mask as one."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return _CAT[0] if file in _CAT else file

    config.option.loadscopereorder = False  # by the number of tests, which says nothing about their time
    return Scheduling(config, log)


@pytest.fixture(scope="session")
def cat(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The cat mask for a man, draft, as 3MF and STL with everything beside them; pictures of half the size."""
    from fabcraft import outputs, pipeline
    from fabcraft.cli import main
    from fabcraft.write import wearer

    folder = tmp_path_factory.mktemp("cat")
    kept: list["Made"] = []
    original = pipeline.make

    def keeping(*arguments, **named) -> "Made":
        kept.append(original(*arguments, **named))
        return kept[-1]

    said, told = io.StringIO(), io.StringIO()
    words = ["make", "mask", "--sketch", str(EXAMPLES / "cat-mask.png"), "--preset", "draft", "--json"]
    words += ["-o", str(folder / "out" / "cat.3mf"), "-o", str(folder / "out" / "cat.stl")]
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(told),
    ):
        patch.setattr(pipeline, "make", keeping)
        for module, name in ((outputs, "PORTRAIT"), (outputs, "BESIDE_BAR"), (wearer, "PORTRAIT")):
            width, height = getattr(module, name)
            patch.setattr(module, name, (width // 2, height // 2))
        code = main(words)
    assert kept, told.getvalue()
    return Run(code, folder, json.loads(said.getvalue()), told.getvalue(), kept[0])

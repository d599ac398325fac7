"""`pytest tests/benchmarks --ratios FILE`: how fast fabcraft is, beside its peers, in one run on the machine at hand.

Every row is measured here and now; ours and the peer take turns, so that both see the same neighbours on a shared
machine. The rows are printed as a table and, with `--ratios`, written as JSON.
"""

import json
import os
from collections.abc import Iterator
from pathlib import Path

# A core that is shared is not to be waited for by spinning; set before torch starts its threads.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # as in a run

import jaxtyping
import pytest
import torch
from measure import Row, table

ROWS = pytest.StashKey[list[Row]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--ratios", type=Path, metavar="FILE", help="write the measured rows to FILE as JSON")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ROWS] = []


@pytest.fixture(scope="session", autouse=True)
def _as_in_a_users_run() -> Iterator[None]:
    """No run-time checks of shapes, which tests switch on; two threads."""
    before, threads = jaxtyping.config.jaxtyping_disable, torch.get_num_threads()
    jaxtyping.config.update("jaxtyping_disable", True)
    torch.set_num_threads(min(2, threads))
    yield
    jaxtyping.config.update("jaxtyping_disable", before)
    torch.set_num_threads(threads)


@pytest.fixture
def rows(request: pytest.FixtureRequest) -> list[Row]:
    """Where a benchmark leaves what it measured."""
    return request.config.stash[ROWS]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    found = terminalreporter.config.stash[ROWS]
    if found:
        terminalreporter.section("ratios")
        terminalreporter.write_line(table(found))


def pytest_sessionfinish(session: pytest.Session) -> None:
    path = session.config.getoption("--ratios")
    if path is not None:
        path.write_text(json.dumps([row.answer() for row in session.config.stash[ROWS]], indent=1) + "\n")

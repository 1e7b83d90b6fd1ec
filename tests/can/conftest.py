"""Tests marked `vcan` run where there are SocketCAN and an own vcan0: see README.md. In CI no test here may be skipped."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import pytest

from tests.can import child_session
from tests.can.child_session import ChildSession
from tests.can.interfaces import INTERFACE, is_up, set_interface

CHILD = pytest.StashKey[ChildSession]()


@pytest.fixture
def vcan() -> Iterator[str]:
    """The name of a virtual CAN interface that is up, with nobody else on it; up again after the test."""
    assert is_up(INTERFACE), f"there is no {INTERFACE} that is up: is the test marked with pytest.mark.vcan?"
    yield INTERFACE
    if not is_up(INTERFACE):
        set_interface(INTERFACE, up=True)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    if child_session.in_child() or not item.get_closest_marker("vcan"):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in _child(item.session).reports(item):
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    # The test before this one has left open what it had in common with this one: the fixtures of its module, say.
    item.session._setupstate.teardown_exact(nextitem)
    return True


def _child(session: pytest.Session) -> ChildSession:
    if CHILD not in session.stash:
        items = [item for item in session.items if item.get_closest_marker("vcan")]
        child = session.stash[CHILD] = ChildSession(session.config, items)
        session.config.add_cleanup(child.close)
    return session.stash[CHILD]


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.skipped and not hasattr(report, "wasxfail") and child_session.is_ci():
        report.outcome = "failed"
        report.longrepr = f"in CI no test here may be skipped: {_reason(report)}"
    child_session.hand_over(report, item.config)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    if report.skipped and child_session.is_ci():
        report.outcome = "failed"
        report.longrepr = f"in CI no test here may be skipped: {_reason(report)}"
    return report


def _reason(report: pytest.TestReport | pytest.CollectReport) -> str:
    return report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)

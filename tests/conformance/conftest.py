"""Fixtures of the conformance suite: every tier and device, with and without an accelerator."""

from pathlib import Path

import pytest


@pytest.fixture(params=["grid", "none"], scope="session")
def accelerator(request):
    return request.param


def pytest_collection_modifyitems(items):
    """Scenes here lie where positions in float32 cannot tell them apart: the warning is right, and not their matter."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.filterwarnings("ignore:positions are float32"))

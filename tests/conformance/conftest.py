"""Fixtures of the conformance suite: every tier and device, with and without an accelerator."""

import pytest


@pytest.fixture(params=["grid", "none"], scope="session")
def accelerator(request):
    return request.param

"""Fixtures: both precisions and every device, each time."""

import numpy as np
import pytest
import warp as wp
from hypothesis import settings

from warprt.kernels.spec import Tier

settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("repeatable")


def device_names():
    """The CPU and every CUDA device."""
    wp.config.log_level = wp.LOG_WARNING
    return [device.alias for device in wp.get_devices()]


# These three have the scope of the session, so that hypothesis may use them: they hold nothing that an example changes.
@pytest.fixture(params=["robust", "mixed", "double"], scope="session")
def accuracy(request):
    """The tiers that promise something."""
    return request.param


@pytest.fixture(params=list(Tier), ids=lambda tier: tier.value, scope="session")
def tier(request):
    """All of them."""
    return request.param


@pytest.fixture(params=[wp.float32, wp.float64], ids=["f32", "f64"], scope="session")
def real(request):
    return request.param


@pytest.fixture(params=device_names(), scope="session")
def device(request):
    return request.param


@pytest.fixture
def rng():
    return np.random.default_rng(7)

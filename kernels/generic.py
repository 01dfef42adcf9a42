"""Argument types that Warp resolves from the arguments of a call."""

from typing import Any

Real = Any
Wide = Any
Vec3 = Any
Mat33 = Any
Struct = Any

"""What the sources of the device code may contain."""

import ast
import sys
from pathlib import Path

import pytest

import warprt.kernels

SOURCES = sorted(Path(warprt.kernels.__file__).parent.glob("*.py"))
TREES = {path.stem: ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}
KERNELS = [
    pytest.param(call, id=f"{name}.{function.name}")
    for name, tree in TREES.items()
    for function in ast.walk(tree)
    if isinstance(function, ast.FunctionDef)
    for call in function.decorator_list
    if "wp.kernel" in ast.unparse(call)
]
INTEGERS_ONLY = {"find_starts"}
"""Kernels without a rounding."""

each_file = pytest.mark.parametrize("name", TREES)


def test_sources_and_kernels_are_found():
    assert {"box", "build", "cast", "grid", "triangle"} <= set(TREES)
    assert len(KERNELS) >= 4


@each_file
def test_kernels_import_only_warp_the_standard_library_and_siblings(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.ImportFrom) and node.level:
            assert node.level == 1
            assert node.module in TREES
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module]
            for module in modules:
                assert module.split(".")[0] in {"warp", *sys.stdlib_module_names}
                assert module != "__future__", "annotations must be types when Warp reads them"


@each_file
def test_kernels_use_no_function_that_breaks_at_the_extremes(name):
    # wp.inverse gives zeros or garbage for large and small matrices, wp.normalize for long and short vectors.
    used = {node.attr for node in ast.walk(TREES[name]) if isinstance(node, ast.Attribute)}
    assert not used & {"inverse", "normalize"}


@pytest.mark.parametrize("call", KERNELS)
def test_kernel_has_no_backward_pass(call):
    assert isinstance(call, ast.Call)
    options = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
    assert options.get("enable_backward") == "False"


@pytest.mark.parametrize("call", [kernel for kernel in KERNELS if kernel.id.split(".")[1] not in INTEGERS_ONLY])
def test_kernel_of_geometry_fixes_its_own_rounding(call):
    options = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
    assert "module_options" in options, "contraction or fast math would be the user's choice"


def test_rounding_options_forbid_contraction_and_fast_math(tier):
    is_fast = tier.value == "fast"
    assert tier.options == {"fast_math": is_fast, "fuse_fp": is_fast}

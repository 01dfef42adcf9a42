"""Warp started without noise."""

import os
import sys
import tempfile

import warp as wp


def start_warp() -> None:
    """Starts Warp without its banner, and without its warning where there is no GPU, which is no fault."""
    wp.config.log_level = wp.LOG_ERROR
    # The warning is written by native code, so the file descriptor itself must be turned away for a moment.
    sys.stderr.flush()
    with tempfile.TemporaryFile() as aside:
        kept = os.dup(2)
        os.dup2(aside.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        aside.seek(0)
        lines = aside.read().decode(errors="replace").splitlines(keepends=True)
    sys.stderr.write("".join(line for line in lines if "NVIDIA CUDA driver" not in line))

"""Scripts in a process of their own, with a time limit, and with a fresh kernel cache if asked."""

import os
import subprocess
import sys
import textwrap


def run_script(code: str, *arguments, timeout: float = 900, cache=None) -> str:
    """What the script prints; it must end with exit status 0 in time. cache: a folder for its kernels."""
    environment = os.environ | ({} if cache is None else {"WARP_CACHE_PATH": str(cache)})
    command = [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, env=environment)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout

"""Networks of cooperative perception: tensors in, tensors out. Importing anything here needs torch.

Start reading at `detector` (one agent), then `cooperative` and `fusion` (several). `inference` has what runs them.
"""

from __future__ import annotations

import importlib.util

from coopsim.errors import MissingDependencyError

if importlib.util.find_spec("torch") is None:
    raise MissingDependencyError(
        "networks need torch: pip install 'coopsim[learn]' (on Linux, first pip install torch "
        "--index-url https://download.pytorch.org/whl/cpu, unless you want the CUDA build of several gigabytes)"
    )

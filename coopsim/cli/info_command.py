"""`coopsim info`: what a report of an error should say of the machine."""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import coopsim
from coopsim.cli.arguments import Command, as_json


def _add_info(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print as JSON")


def _run_info(options: argparse.Namespace) -> int:
    about = about_machine()
    if options.json:
        print(as_json(about), end="")
    else:
        for name, value in about.items():
            print(f"{name + ':':<12}{_text(value)}")
    return 0


def about_machine() -> dict[str, Any]:
    """Return versions, and what networks, cameras and data of this machine can be used."""
    from coopsim.bench.store.packages import package_versions
    from coopsim.cli.listing import listing

    return {
        "coopsim": coopsim.__version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "folder": str(Path(str(coopsim.__file__)).parent),
        "packages": package_versions(),
        "OpenGL": _tried(_opengl),
        **_torch(),
        "weights": [entry["name"] for entry in listing()["weights"]()],
        "data": _data(),
    }


def _tried(describe: Callable[[], str]) -> str:
    """Return a description, or why there is none: drivers raise anything."""
    try:
        return describe()
    except Exception as error:
        return f"none ({str(error).splitlines()[0] if str(error) else type(error).__name__})"


def _opengl() -> str:
    from coopsim.sensors.camera.renderers import make_context

    context = make_context()
    try:
        return f"{context.info['GL_VERSION']}, {context.info['GL_RENDERER']}"
    finally:
        context.release()


def _torch() -> dict[str, str]:
    """Describe torch, the arithmetic of networks on the processor, and GPUs."""
    if importlib.util.find_spec("torch") is None:
        return {"torch": "none (pip install 'coopsim[learn]')"}
    import torch

    from coopsim.support.precision import arithmetic

    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    gpus = [torch.cuda.get_device_name(number) for number in range(count)]
    return {"torch": torch.__version__, "arithmetic": arithmetic(), "GPU": ", ".join(gpus) or "none"}


def _data() -> str:
    folder = os.environ.get("COOPSIM_DATA")
    if not folder:
        return "none (COOPSIM_DATA is not set)"
    return folder if Path(folder).is_dir() else f"{folder} (COOPSIM_DATA, but there is no such folder)"


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {number}" for name, number in value.items())
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


INFO = Command(
    "describe this machine: versions, OpenGL, torch, bfloat16, GPU, weights and the path of data",
    _add_info,
    _run_info,
    ("coopsim info", "coopsim info --json"),
)

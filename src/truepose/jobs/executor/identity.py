"""What the last digits of a result depend on: the code, its libraries, and the kernels of linear algebra."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

from truepose._version import RELEASE


@cache
def code_hash() -> str:
    """Return the SHA-256 of the code: the same for a wheel and a checkout of the same sources."""
    root = Path(__file__).parents[2]
    code = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        code.update(path.relative_to(root).as_posix().encode() + path.read_bytes().replace(b"\r\n", b"\n"))
    return code.hexdigest()


@cache
def identity() -> dict[str, str]:
    """Return what must be the same in all processes that share work, each by its name."""
    from threadpoolctl import threadpool_info

    blas = {str(one.get("architecture", one["internal_api"])) for one in threadpool_info() if one["user_api"] == "blas"}
    return {
        "truepose": f"{RELEASE}, code {code_hash()[:12]}",
        "Python": ".".join(platform.python_version_tuple()[:2]),
        **{name: version(name) for name in ("numpy", "scipy", "numba", "scikit-learn")},
        "linear algebra kernels": ", ".join(sorted(blas)),
    }


def differences(own: dict[str, str], other: dict[str, str]) -> str:
    """Return in words how the identity of another process differs; empty if it does not."""
    return "; ".join(
        f"{name} {other.get(name, 'unknown')}, here {mine}" for name, mine in own.items() if other.get(name) != mine
    )

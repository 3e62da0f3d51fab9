"""The kind of file system that a path is on: SQLite's locks and shared memory do not work over a network."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path, PurePath
from typing import Final

from truepose.errors import StoreError

_NETWORK: Final = frozenset(
    [
        "9p",
        "acfs",
        "afpfs",
        "afs",
        "beegfs",
        "ceph",
        "cephfs",
        "cifs",
        "coda",
        "davfs",
        "fuse.davfs2",
        "glusterfs",
        "gpfs",
        "lustre",
        "ncpfs",
        "nfs",
        "nfs3",
        "nfs4",
        "orangefs",
        "panfs",
        "prl_fs",
        "pvfs2",
        "smb",
        "smb2",
        "smb3",
        "smbfs",
        "vboxsf",
        "vmhgfs",
        "webdav",
    ]
)
_LOCAL_FUSE: Final = frozenset(
    f"fuse.{name}" for name in ("ext4", "exfat", "fuse-overlayfs", "mergerfs", "ntfs", "ntfs-3g", "zfs", "btrfs")
)
_MOUNTS: Final = Path("/proc/mounts")
_MOUNT_LINE: Final = re.compile(r"^.+? on (?P<place>/.*) \((?P<kind>[\w.-]+)", re.MULTILINE)
_REMOTE_DRIVE: Final = 4  # DRIVE_REMOTE of GetDriveTypeW


def refuse_network(path: Path) -> None:
    """Refuse a path on a file system that is shared over a network.

    Raises
    ------
    StoreError
        If it is one: locks may not hold there, and two writers would damage the database.
    """
    if is_network(kind := kind_of(path)):
        raise StoreError(
            f"{path}: is on a network share ({kind}), where SQLite's locks do not hold; "
            "use a local disk, or PostgreSQL for several machines"
        )


def is_network(kind: str) -> bool:
    """Return whether a kind of file system is shared over a network; user-space ones are unless they are known.

    Examples
    --------
    >>> [is_network(kind) for kind in ("ext4", "nfs4", "fuse.sshfs", "fuseblk")]
    [False, True, True, False]
    """
    return kind in _NETWORK or (kind.startswith("fuse.") and kind not in _LOCAL_FUSE)


def kind_of(path: Path) -> str:
    """Return the kind of the file system of a path that need not exist; empty if the system does not tell it."""
    real = path.resolve()
    if sys.platform == "win32":
        return _windows_kind(real)
    if sys.platform == "darwin":
        listed = subprocess.run(["/sbin/mount"], capture_output=True, text=True, check=False).stdout
        return kind_in([(m["place"], m["kind"]) for m in _MOUNT_LINE.finditer(listed)], real)
    try:
        lines = _MOUNTS.read_text("utf-8", "surrogateescape").splitlines()
    except OSError:
        return ""
    mounts = [(_unescaped(words[1]), words[2]) for line in lines if len(words := line.split(" ")) > 2]
    return kind_in(mounts, real)


def kind_in(mounts: list[tuple[str, str]], path: PurePath) -> str:
    """Return the kind of the deepest mounted folder that holds a path; the last one if several are at one place."""
    holding = [(len(PurePath(place).parts), i) for i, (place, _) in enumerate(mounts) if path.is_relative_to(place)]
    return mounts[max(holding)[1]][1] if holding else ""


def _unescaped(place: str) -> str:
    r"""Return a place of /proc/mounts, where blanks are ``\040``."""
    return re.sub(r"\\([0-7]{3})", lambda found: chr(int(found[1], 8)), place)


def _windows_kind(path: PurePath) -> str:
    if path.drive.startswith("\\\\"):
        return "smb"
    import ctypes

    windows = ctypes.windll.kernel32  # type: ignore[attr-defined, unused-ignore]
    return "smb" if windows.GetDriveTypeW(f"{path.drive}\\") == _REMOTE_DRIVE else "local"

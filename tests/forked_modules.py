"""What a process that jobs are forked from imports: see `tests.forked`."""

import importlib
import pkgutil

import truepose
from truepose.errors import MissingPackageError

for _module in pkgutil.walk_packages(truepose.__path__, "truepose."):
    if not _module.name.endswith("__main__") and ".web" not in _module.name and ".bench" not in _module.name:
        try:
            importlib.import_module(_module.name)
        except MissingPackageError:
            continue

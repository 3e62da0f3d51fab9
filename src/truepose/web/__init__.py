"""The application in the browser: the same functions as the command line, for one person on one machine.

It needs the extra ``truepose[app]``. Nothing below imports it; `truepose app` starts it.
"""

from typing import TYPE_CHECKING

from truepose._lazy import lazy_names

if TYPE_CHECKING:
    from truepose.web.app import create_app
    from truepose.web.workspace import Workspace

__all__ = ["Workspace", "create_app"]

__getattr__ = lazy_names(__name__, {"Workspace": "workspace", "create_app": "app"})

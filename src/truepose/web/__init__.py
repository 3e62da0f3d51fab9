"""The application in the browser: the same functions as the command line, for one person on one machine.

It needs the extra ``truepose[app]``. Nothing below imports it; `truepose app` starts it.
"""

from truepose.web.app import create_app
from truepose.web.workspace import Workspace

__all__ = ["Workspace", "create_app"]

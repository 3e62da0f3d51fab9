"""The commented robot file to start from."""

from __future__ import annotations

from importlib.resources import files


def robot_template() -> str:
    """Return a commented robot file (TOML) to fill in, which is valid as it is.

    Examples
    --------
    >>> from truepose.robots import parse_robot
    >>> parse_robot(robot_template()).dof
    6
    """
    return (files("truepose.robots.io") / "template.toml").read_text("utf-8")

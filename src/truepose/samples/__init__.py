"""The table of commanded poses and measurements, its file (the tidy table), and the checks on it."""

from truepose.samples.checks import check, check_against, check_not_compensated, check_turns, looks_like_metres
from truepose.samples.conditions import approach_from_order
from truepose.samples.examples import Example, load_example
from truepose.samples.masks import Mask, mask_table, read_mask, set_aside
from truepose.samples.naming import name_one, name_points
from truepose.samples.reflectors import check_reflector_rows, check_rigid, reflector_index, visits
from truepose.samples.rounding import decimal_step
from truepose.samples.shown import on_arm
from truepose.samples.table import Distances, Poses, Samples
from truepose.samples.tidy import (
    append_columns,
    read_all_samples,
    read_distances,
    read_poses,
    read_samples,
    samples_text,
    write_samples,
)

__all__ = [
    "Distances",
    "Example",
    "Mask",
    "Poses",
    "Samples",
    "append_columns",
    "approach_from_order",
    "check",
    "check_against",
    "check_not_compensated",
    "check_reflector_rows",
    "check_rigid",
    "check_turns",
    "decimal_step",
    "load_example",
    "looks_like_metres",
    "mask_table",
    "name_one",
    "name_points",
    "on_arm",
    "read_all_samples",
    "read_distances",
    "read_mask",
    "read_poses",
    "read_samples",
    "reflector_index",
    "samples_text",
    "set_aside",
    "visits",
    "write_samples",
]

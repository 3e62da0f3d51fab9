"""Read measurement files of known layouts and match them with a plan."""

from truepose.trackers.columns import Columns
from truepose.trackers.formats.joint_files import read_plan
from truepose.trackers.importing import import_readings, read_measurement
from truepose.trackers.layout import Layout, first_row_matches, in_columns, row_names
from truepose.trackers.matching import ImportSummary, match
from truepose.trackers.preview import FilePreview, preview
from truepose.trackers.readings import Readings
from truepose.trackers.recognise import LAYOUTS, read_readings, write_readings
from truepose.trackers.reflectors import combine_reflectors

__all__ = [
    "LAYOUTS",
    "Columns",
    "FilePreview",
    "ImportSummary",
    "Layout",
    "Readings",
    "combine_reflectors",
    "first_row_matches",
    "import_readings",
    "in_columns",
    "match",
    "preview",
    "read_measurement",
    "read_plan",
    "read_readings",
    "row_names",
    "write_readings",
]

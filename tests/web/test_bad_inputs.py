"""Which test shows that a bad input does no harm; and that these tests exist.

=============================  =======================================================================================
input                          tests
=============================  =======================================================================================
zip bomb                       web/test_uploads.py::test_a_zip_that_is_no_backup_is_refused_and_not_kept
..                             web/test_meshes.py::test_a_bad_zip_is_refused_whole
``../`` and absolute names     web/test_uploads.py::test_names_are_never_paths
..                             web/test_uploads.py::test_a_zip_that_is_no_backup_is_refused_and_not_kept
..                             web/test_measure.py::test_names_of_files_are_never_paths_or_options
..                             web/test_verifications.py::test_names_of_readings_are_never_paths_or_options
..                             web/test_meshes.py::test_names_of_a_dropped_folder_are_never_paths
..                             web/test_cells.py::test_names_of_cells_are_never_paths
..                             web/test_corrections.py::test_a_record_never_leads_out_of_its_cell
symlinks                       web/test_uploads.py::test_a_link_in_a_zip_is_never_followed
..                             web/test_meshes.py::test_a_link_in_a_zip_is_not_followed
..                             web/test_workspace.py::test_links_are_not_followed
upload cut off                 web/test_uploads.py::test_an_upload_that_is_cut_off_leaves_nothing
..                             web/test_measure.py::test_an_upload_that_is_cut_off_leaves_nothing
2 GB                           web/test_uploads.py::test_two_gigabytes_are_refused_by_their_stated_size
..                             web/test_measure.py::test_two_gigabytes_are_refused_by_their_stated_and_their_true_size
..                             web/test_jobs.py::test_two_gigabytes_are_refused_while_they_stream_and_take_neither_memory_nor_disk
NaN in JSON                    web/test_maps.py::test_numbers_that_are_none_are_refused
..                             web/test_measure.py::test_statements_that_make_no_sense_are_refused
..                             web/test_cells.py::test_values_that_no_cell_file_can_hold_are_refused
a map from a stranger          web/test_reports.py::test_a_map_of_a_stranger_in_the_folder_is_a_refusal_and_no_crash
..                             web/test_maps.py::test_a_broken_map_is_listed_with_its_problem_and_has_no_address
a map of another cell          web/test_programs.py::test_a_map_of_another_cell_is_refused
..                             web/test_maps.py::test_a_map_of_another_cell_says_so
corrected before               web/test_programs.py::test_a_program_that_was_corrected_before_is_refused_with_the_words_of_the_command_line
names differing in case        web/test_uploads.py::test_names_that_are_one_file_on_some_systems_are_refused
..                             web/test_cells.py::test_names_that_differ_in_case_only_are_two_cells
CRLF                           web/test_cells.py::test_line_ends_and_mark_of_a_file_from_windows_survive
..                             web/test_programs.py::test_no_byte_outside_the_digits_changes
..                             web/test_corrections.py::test_lines_end_as_the_readers_say
UTF-16                         web/test_measure.py::test_encodings_and_line_ends_make_no_difference
..                             web/test_programs.py::test_what_is_no_program_is_told_in_words
Shift-JIS                      web/test_measure.py::test_a_name_in_the_bytes_of_shift_jis_is_taken
..                             web/test_programs.py::test_no_byte_outside_the_digits_changes
..                             web/test_corrections.py::test_comments_are_shown_in_the_letters_of_their_controller
two tabs and one cell          web/test_cells.py::test_two_tabs_lose_nothing
disk full                      web/test_uploads.py::test_a_full_disk_leaves_nothing
..                             web/test_cells.py::test_a_full_disk_changes_nothing
..                             web/test_measure.py::test_a_full_disk_leaves_neither_readings_nor_a_job
..                             jobs/test_queue.py::test_a_full_disk_fails_what_cannot_be_written_and_the_queue_lives
server killed in a job         web/test_jobs.py::test_a_job_of_a_killed_server_is_interrupted_and_runs_again
server killed in a write       web/test_killed.py::test_a_server_killed_between_two_renames_leaves_all_or_nothing_and_the_job_runs_again
..                             web/test_uploads.py::test_a_server_that_is_killed_during_an_upload_shows_nothing
clock set back                 jobs/test_queue.py::test_the_order_does_not_depend_on_the_clock
..                             web/test_cells.py::test_the_version_is_that_of_the_content_and_no_clock
token missing (401)            web/test_guard.py::test_without_a_session_nothing_is_told
token wrong (403, 429)         web/test_guard.py::test_wrong_tries_are_refused_and_then_stopped
foreign Origin                 web/test_guard.py::test_a_foreign_origin_changes_nothing
foreign Host                   web/test_guard.py::test_a_foreign_host_gets_no_answer
wrong cookies (403, 429)       web/test_guard.py::test_wrong_cookies_count_and_the_lock_ends_after_its_time
any JSON, any endpoint         web/test_any_request.py::test_any_request_has_an_answer
rows that hold no number       web/test_measure.py::test_a_row_that_holds_no_number_is_shown_and_can_be_masked
markup in names                web/test_corrections.py::test_names_with_markup_stay_text
..                             web/test_uploads.py::test_names_are_never_paths
..                             browser/test_programs.py::test_names_with_markup_are_text_and_fit_a_narrow_window
=============================  =======================================================================================
"""  # noqa: E501

from __future__ import annotations

import ast
import re
from pathlib import Path

TESTS = Path(__file__).parents[1]


def test_the_tests_of_the_table_exist() -> None:
    named = re.findall(r"(\w+/\w+\.py)::(\w+)", __doc__)
    assert len(named) > 40
    known = {
        file: {
            node.name for node in ast.parse((TESTS / file).read_text("utf-8")).body if isinstance(node, ast.FunctionDef)
        }
        for file in {file for file, _ in named}
    }
    assert [f"{file}::{test}" for file, test in named if test not in known[file]] == []

"""What each endpoint needs: the one table. An endpoint that is not in it is refused to everybody."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from truepose.errors import RefusedError
from truepose.store.roles import Action, Role, check_permitted
from truepose.web.problems import WebError

_VIEW: Final = (
    *("session", "log_out", "change_password", "list_tokens", "make_token", "remove_token"),
    *("list_cells", "robots", "read_cell", "check_cell", "list_files", "download_file"),
    *("robot_arm", "cell_arm", "unsaved_arm", "meshes", "mesh_data"),
    *("plan_methods", "plans", "sample_tables", "plan_table", "sample_table", "expected", "program"),
    *("predictors", "list_maps", "map_facts", "candidates", "map_arrays", "map_slices", "map_volume", "map_table"),
    *("map_curves", "map_variogram", "refit_variogram", "predict"),
    *("programs", "preview_state", "preview_targets", "preview_path"),
    *("corrections", "correction_detail", "targets", "correction_path", "correction_diff", "correction_files"),
    *("correction_record", "correction_coverage"),
    *("verifiable", "verifications", "verification", "reports", "write", "download", "preview"),
    *("history", "history_table", "list_jobs", "get_job", "job_result", "job_events"),
    *("stored_maps", "map_states", "recalled", "recall_table", "audit_trail", "drift"),
    *("cancel_job", "run_job_again"),  # these check the command of the job, too
)
NEEDED: Final[dict[str, Action]] = {
    **dict.fromkeys(_VIEW, "view"),
    "new_cell": "measure",
    "virtual_cell": "measure",
    "save_cell": "measure",
    "upload_meshes": "measure",
    "remove_meshes": "measure",
    "make_plan": "measure",
    "send_readings": "measure",
    "mask_samples": "measure",
    "fit_map": "fit",
    "validate_map": "verify",
    "upload_programs": "correct",
    "check_program": "correct",
    "correct_program": "correct",
    "verify": "verify",
    "list_users": "manage",
    "new_user": "manage",
    "change_user": "manage",
    "release": "release",
    "withdraw": "release",
}
"""The action that a user must be permitted, by the name of the endpoint."""
OPEN: Final = frozenset({"log_in", "log_ins", "begin_oidc", "finish_oidc"})
"""Endpoints that nobody has logged in for yet."""
OF_COMMANDS: Final[dict[str, Action]] = {
    **dict.fromkeys(("demo", "warm-up", "plan", "import", "mask", "init", "check-point"), "measure"),
    **dict.fromkeys(("fit", "update", "study"), "fit"),
    **dict.fromkeys(("correct", "check", "frames"), "correct"),
    **dict.fromkeys(("verify", "validate"), "verify"),
    **dict.fromkeys(("robots", "similarity", "iso9283", "explain", "predict", "report"), "view"),
}
"""The action of a job, by the name of its command: for running one again, and for cancelling that of another user."""


def check(name: str, roles: Iterable[Role], endpoint: str) -> None:
    """Refuse an endpoint that no role of a user permits.

    Raises
    ------
    WebError
        With status 403; the message names the roles that would permit it.
    """
    if endpoint not in NEEDED:
        raise WebError(403, "Role missing", f"nobody may use the endpoint {endpoint} of a server with users")
    check_action(name, roles, NEEDED[endpoint])


def check_action(name: str, roles: Iterable[Role], action: Action) -> None:
    """Refuse an action that no role of a user permits, as `check` does."""
    try:
        check_permitted(name, roles, action)
    except RefusedError as error:
        raise WebError(403, "Role missing", str(error)) from None

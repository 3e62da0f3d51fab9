"""Programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell

_W1 = "w1=p[0.4,0.1,0.3,0,3.14,0]"
_W2 = "w2=p[0.5,-0.1,0.3,0,3.14,0]"
_A = "set_tcp(p[0,0,0.1,0,0,0])"
_B = "set_tcp(p[0,0,0.25,0,0,0])"


def _program(*lines: str) -> dict[str, str]:
    """Return a script whose function `a` has these lines; line 1 is its head."""
    return {"a.script": "\n".join(["def a():", *(f"  {line}" for line in lines), "end", ""])}


def _cell(*lines: str, **wanted: str) -> Cell:
    return Cell(_program(*lines), {name.replace("line_", "line "): verdict for name, verdict in wanted.items()})


CELLS: dict[str, list[Cell]] = {
    "unknown-statement": [
        _cell(_A, _W1, "vendor_reset(w1)", "movel(w1)", w1="refuse"),
        _cell(_A, _W1, "vendor_light(3)", "movel(w1)", w1="correct"),
    ],
    "coordinate-in-position": [_cell(_A, _W1, "movel(p[w1[0],w1[1],0.5,0,3.14,0])", "movel(w1)", w1="refuse")],
    "coordinate-in-number": [
        _cell(_A, _W1, "h=w1[2]", "set_standard_analog_out(0,h)", "movel(w1)", w1="refuse"),
        _cell(_A, _W1, "if w1[2]>0.2:", "  sleep(1)", "end", "movel(w1)", w1="refuse"),
    ],
    "coordinate-in-frame": [
        _cell(_A, _W1, _W2, "movel(pose_trans(p[0,0,w1[2],0,0,0],w2))", "movel(w1)", "movel(w2)", w1="refuse")
    ],
    "expression-in-modifier": [_cell(_A, _W1, "movel(w1)", "movel(p[0.4,0,0.3,0,3.14,0],v=w1[2])", w1="refuse")],
    "called-program-sets-frame": [
        _cell("def grip():", f"  {_B}", "end", _A, _W1, "movel(w1)", "grip()", "movel(w1)", w1="refuse")
    ],
    "handler-changes-state": [
        _cell("thread t():", f"  {_B}", "  sleep(1)", "end", _A, _W1, "h=run t()", "movel(w1)", w1="refuse")
    ],
    "certain-loop": [
        _cell(
            _A,
            _W1,
            "i=0",
            "while i<3:",
            f"  {_B}",
            "  i=i+1",
            "end",
            "movel(w1)",
            "movel(p[0.4,0,0.3,0,3.14,0])",
            w1="refuse",
        )
    ],
    "conditional-frame": [
        _cell(_A, _W1, "if get_standard_digital_in(1):", f"  {_B}", "end", "movel(w1)", w1="refuse"),
        _cell(_A, _W1, "if get_standard_digital_in(1):", "  sleep(1)", "end", "movel(w1)", w1="correct"),
    ],
    "routine-like-a-motion": [
        _cell(
            "def movel_rel(d):",
            "  movel(pose_trans(get_actual_tcp_pose(),d))",
            "end",
            _A,
            "movel_rel(p[0,0,0.1,0,0,0])",
            "movel(p[0.4,0.1,0.3,0,3.14,0])",
            line_7="correct",
        ),
    ],
    "array-element": [
        _cell(
            _A,
            _W1,
            _W2,
            "ws=[w1,w2]",
            "i=0",
            "while i<2:",
            "  movel(pose_add(ws[i],get_target_tcp_pose()))",
            "  i=i+1",
            "end",
            "movel(w1)",
            w1="refuse",
        )
    ],
    "whole-array": [
        _cell(_A, _W1, "ws=[w1]", "vs=ws", "movel(pose_add(vs[0],get_target_tcp_pose()))", "movel(w1)", w1="refuse")
    ],
    "initial-value": [
        _cell(
            "def go(w=p[0.4,0,0.3,0,3.14,0]):",
            f"  {_B}",
            "  movel(w)",
            "end",
            _A,
            _W1,
            "go(w1)",
            "movel(w1)",
            w1="refuse",
        )
    ],
    "routine-in-an-expression": [
        _cell(
            "def ask():",
            f"  {_B}",
            "  return True",
            "end",
            _A,
            _W1,
            "movel(w1)",
            "if ask():",
            "  movel(w1)",
            "end",
            w1="refuse",
        )
    ],
    "argument-by-name": [
        _cell("def grip(n):", f"  {_B}", "end", _A, _W1, "movel(w1)", "grip(n=1)", "movel(w1)", w1="refuse")
    ],
    "optional-argument": [
        _cell("def say(n,w=0):", f"  {_B}", "  movel(w)", "end", _A, _W1, "movel(w1)", "say(1,w1)", w1="refuse")
    ],
    "argument-not-followed": [
        _cell(
            "def go(w):",
            "  movel(w)",
            "end",
            _A,
            _W1,
            "off=get_actual_tcp_pose()",
            "go(w1)",
            "go(pose_add(w1,off))",
            w1="refuse",
        )
    ],
    "tool-through-argument": [
        _cell("def use(t):", "  set_tcp(t)", "end", _A, _W1, "movel(w1)", "use(w1)", w1="refuse"),
    ],
    "continue-in-loop": [
        _cell(
            _A,
            _W1,
            "while True:",
            "  movel(w1)",
            f"  {_B}",
            "  if get_standard_digital_in(1):",
            "    continue",
            "  end",
            f"  {_A}",
            "end",
            w1="refuse",
        )
    ],
    "inverse-kinematics": [
        _cell(_A, _W1, _W2, "q=get_inverse_kin(w1,[w2[0],0,0,0,0,0])", "movej(q)", "movel(w2)", w2="refuse")
    ],
    "chain-of-copies": [
        _cell(
            _A,
            _W1,
            "u=w1",
            "if get_standard_digital_in(1):",
            "  sleep(1)",
            "end",
            "v=u",
            "movel(pose_add(v,get_target_tcp_pose()))",
            "movel(w1)",
            w1="refuse",
        )
    ],
    "index-read": [_cell(_A, _W1, _W2, "ws=[w2]", "movel(ws[floor(w1[0])])", "movel(w1)", w1="refuse")],
    "arithmetic-on-a-point": [_cell(_A, _W1, "w1[2]=w1[2]+0.05", "movel(w1)", w1="refuse")],
    "run-time-shift": [
        _cell(_A, _W1, "movel(w1)", "movel(pose_trans(get_target_tcp_pose(),w1))", w1="refuse"),
    ],
    "two-frames": [_cell(_A, _W1, "movel(w1)", _B, "movel(w1)", w1="refuse")],
    "sensor-shift": [
        _cell(
            _A,
            _W1,
            "force_mode(p[0,0,0,0,0,0],[0,0,1,0,0,0],[0,0,10,0,0,0],2,[0.1,0.1,0.1,0.1,0.1,0.1])",
            "movel(w1)",
            "end_force_mode()",
            w1="refuse",
        ),
    ],
    "alias": [_cell(_A, _W1, "v=w1", _B, "movel(v)", _A, "movel(w1)", w1="refuse")],
    "recursion": [
        _cell(
            "def deep(n):",
            f"  {_B}",
            "  if n>0:",
            "    deep(n-1)",
            "  end",
            "end",
            _A,
            _W1,
            "movel(w1)",
            "deep(3)",
            "movel(w1)",
            w1="refuse",
        )
    ],
    "unreachable-code": [
        _cell(_A, _W1, "movel(w1)", "halt", _B, "movel(w1)", w1="refuse"),
    ],
    "state-across-calls": [
        _cell(
            "def inner():",
            f"  {_B}",
            "end",
            "def outer():",
            "  inner()",
            "end",
            _A,
            _W1,
            "movel(w1)",
            "outer()",
            "movel(w1)",
            w1="refuse",
        )
    ],
}
ABSENT: dict[str, str] = {
    "called-program-shifts": "no statement leaves a shift in force; path offsets and force mode are sensor-shift",
    "frame-written-by-call": "a TCP is set by set_tcp alone, features are values; see tool-through-argument",
    "error-leaves-a-routine": "an error ends the program; there are no handlers",
    "argument-written": "arguments are values: a routine changes its own copy",
    "compact-condition": "a condition and its statement stand on lines of their own",
    "routine-in-a-motion": "a motion runs no routine by its name",
}

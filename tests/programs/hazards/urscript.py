"""Programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell
from tests.programs.urp_files import Waypoint, move, program

from truepose.programs import ReadOptions

P, Q = "p[0.4,-0.3,0.3,0,3.14,0]", "p[0.5,-0.2,0.25,0,3.14,0]"
A, B = "set_tcp(p[0,0,0.1,0,0,0])", "set_tcp(p[0,0,0.25,0,0,0])"
DERIVED = ReadOptions(derived=True)
JOINTS = ReadOptions(joint_targets=True)


def cell(code: str, options: ReadOptions | None = None, **wanted: str) -> Cell:
    """Return a program of its statements; the name of a target has _ in place of blanks and colons."""
    lines = "\n".join(f"  {line}" for line in code.strip().splitlines())
    names = {name.replace("__", ":").replace("_argument_", " argument "): verdict for name, verdict in wanted.items()}
    return Cell({"a.script": f"def prog():\n{lines}\nend\n"}, names, options or ReadOptions())


def urp(nodes: str, verdict: str) -> Cell:
    """Return a program of the editor: a Move to W1, and other nodes around it."""
    waypoint = Waypoint("W1", (-1.5, -1.6, 1.9, -1.8, -1.5, 0.2))
    return Cell({"a.urp": program([nodes.replace("MOVE", move([waypoint]))])}, {"W1": verdict}, JOINTS)


CELLS: dict[str, list[Cell]] = {
    "unknown-statement": [
        cell(f"{A}\nw1={P}\nmovel(w1)\n@shift w1 by 5\nmovel({Q})", w1="refuse", movel__6="correct"),
        cell(f"w1={P}\n{A}\nmovel(w1)\n@placeholder\nuse()\nmovel(w1)\ndef use():\n{B}\nend", w1="refuse"),
        cell(f'{A}\n$ 3 "Move"\n@placeholder\nmovel({P})', movel__5="correct"),
    ],
    "coordinate-in-position": [
        cell(f"w1={P}\nmovel(w1)\nmovel(p[w1[1],w1[0],0.3,0,3.14,0])", w1="refuse", movel__4="skip"),
        cell(f"w1={P}\nx=0.1\nmovel(w1)\nmovel(p[x,0.2,0.3,0,3.14,0])", w1="correct", movel__5="skip"),
    ],
    "coordinate-in-number": [
        cell(f"w1={P}\nw2={Q}\nh=w1[2]\nmovel(w1)\nmovel(w2)\nmovel(p[0.1,0.2,h,0,3.14,0])", w1="refuse", w2="correct"),
        cell(f"w1={P}\nif w1[2] > 0.2:\nmovel({Q})\nend\nmovel(w1)", w1="refuse", movel__4="correct"),
        cell(f"w1={P}\nmovel(w1)\nset_standard_analog_out(0, w1[2])", w1="refuse"),
        cell(f"w1={P}\ndef high():\nreturn w1[2]\nend\nmovel(w1)\nx=high()", w1="refuse"),
    ],
    "coordinate-in-frame": [
        cell(f"w1={P}\nf=p[0.1,0.2,w1[2],0,0,0]\nmovel(w1)\nmovel(pose_trans(f,{Q}))", w1="refuse", movel__5="skip"),
        cell(f"w1={P}\nf={Q}\nf[2]=w1[2]\nmovel(w1)\nmovel(pose_trans(f,{Q}))", w1="refuse", movel__6="skip"),
        cell(f"w1={P}\nmovel(w1)\nmovel(pose_trans(w1,{Q}))", DERIVED, w1="refuse", movel__4="skip"),
    ],
    "expression-in-modifier": [
        cell(f"w1={P}\nmovel(w1)\nmovel({Q}, v=w1[2])", w1="refuse", movel__4="correct"),
        cell(f"w1={P}\nmovel({Q}, r=pose_dist(w1, {Q})*0.1)\nmovel(w1)", w1="refuse", movel__3="correct"),
    ],
    "called-program-shifts": [
        cell(
            f"def belt():\ntrack_conveyor_linear(p[1,0,0,0,0,0], 500)\nend\nmovel({P})\nbelt()\nmovel({Q})",
            movel__5="correct",
            movel__7="refuse",
        ),
        cell(
            f"def push():\nforce_mode(f,[0,0,1,0,0,0],w,2,l)\nend_force_mode()\nend\npush()\nmovel({P})",
            movel__7="correct",
        ),
        cell(f"def push(n):\nforce_mode(f,[0,0,1,0,0,0],w,2,l)\nend\npush(n=1)\nmovel({P})", movel__6="refuse"),
    ],
    "called-program-sets-frame": [
        cell(f"def grip():\nif x:\n{B}\nend\nend\n{A}\ngrip()\nmovel({P})", movel__9="refuse"),
        cell(f"def grip():\nsleep(1)\nend\n{A}\ngrip()\nmovel({P})", movel__7="correct"),
    ],
    "handler-changes-state": [
        cell(f"def push():\nforce_mode(a,b)\nend\nthread t():\npush()\nend\nrun t()\nmovel({P})", movel__9="refuse"),
        cell(
            f"def other():\n{B}\nsleep(1)\n{A}\nend\nthread t():\nother()\nend\n{A}\nrun t()\nmovel({P})",
            movel__12="refuse",
        ),
        cell(f"thread t():\nmovel({P})\nend\ndef begin():\nrun t()\nend\n{A}\nbegin()\n{B}", movel__3="refuse"),
        cell(f"thread t():\n{A}\nmovel({P})\nend\nrun t()\n{B}\nsleep(1)", movel__4="refuse"),
        cell(
            f"thread t():\nmovel({P})\nend\ndef begin():\nrun t()\nend\nbegin()\npath_offset_enable()",
            movel__3="refuse",
        ),
        cell(f"thread t():\nn=n+1\nend\n{A}\nrun t()\nmovel({P})", movel__7="correct"),
        cell(f"thread t():\n{B}\nend\n{A}\nmovel({P})", movel__6="correct"),
        urp(
            "<Thread><children><Script>def push():\nforce_mode(a,b)\nend\npush()</Script></children></Thread>MOVE",
            "refuse",
        ),
    ],
    "certain-loop": [
        cell(f"{A}\ni=0\nwhile i < 3:\n{B}\ni=i+1\nend\nmovel({P})", movel__8="refuse"),
        cell(f"{A}\ni=0\nwhile i < 3:\nmovel({P})\ni=i+1\nend", movel__5="correct"),
    ],
    "conditional-frame": [
        cell(f"{A}\nif get_digital_in(1):\n{B}\nend\nmovel({P})", movel__6="refuse"),
        cell(f"if get_digital_in(1):\n{A}\nelse:\n{B}\nend\nmovel({P})", movel__7="refuse"),
        cell(f"if get_digital_in(1):\n{A}\nelse:\n{A}\nend\nmovel({P})", movel__7="correct"),
    ],
    "frame-written-by-call": [
        cell(f"f={Q}\nf=calibrate(f)\nmovel(pose_trans(f,{P}))", movel__4="skip"),
        cell(f"t=p[0,0,0.1,0,0,0]\nt=get_tcp_offset()\nset_tcp(t)\nmovel({P})", movel__5="refuse"),
        cell(f"def lift(t):\nt[2]=0.2\nset_tcp(t)\nend\nt=p[0,0,0.1,0,0,0]\nlift(t)\nmovel({P})", movel__8="refuse"),
    ],
    "routine-like-a-motion": [
        cell(
            "def movel_rel(d):\nmovel(pose_trans(get_actual_tcp_pose(), d))\nend\nmovel_rel(p[0,0,0.1,0,0,0])",
            **{"movel:3": "skip", "line 5": "skip"},
        ),
        cell(f"def movel_tool(t):\nset_tcp(t)\nend\nt={P}\nmovel_tool(t)\nmovel(t)", t="refuse"),
        cell(f"movel_rel({P})\nw1={Q}\nmovel_rel(w1)\nmovel(w1)", movel_rel__2="refuse", w1="refuse"),
        cell(f"def movel(w):\n{B}\nend\nw1={Q}\n{A}\nmovej(w1)\nmovel({P})\nmovej(w1)", w1="refuse"),
        cell(f"def movel_fast(w):\nmovel(w, v=1)\nend\n{A}\nmovel_fast({P})", movel_fast__6_argument_1="correct"),
    ],
    "array-element": [
        cell(f"pts=[{P},{Q}]\ni=0\nwhile i<2:\n{A}\nmovel(pts[i])\n{B}\nmovel(pts[1-i])\nend", **{"pts[0]": "refuse"}),
        cell(f"pts=[{P},{Q}]\npts[i]=where()\nmovel(pts[0])", **{"pts[0]": "skip"}),
        cell(
            f"pts=[{P},{Q}]\ni=0\nwhile i<2:\nmovel(pts[i])\ni=i+1\nend", **{"pts[0]": "correct", "pts[1]": "correct"}
        ),
    ],
    "whole-array": [
        cell(f"pts=[{P},{Q}]\nqs=pts\nqs[0]=pose_add(qs[0],off)\nmovel(pts[0])\nmovel(qs[1])", **{"pts[0]": "refuse"}),
        cell(f"w1={P}\npts=[w1,{Q}]\nmovel(w1)\nmovel(pose_add(pts[0],off))", w1="refuse"),
        cell(
            f"def run_all(path):\nmovel(pose_add(path[0],off))\nend\npts=[{P},{Q}]\nmovel(pts[0])\nrun_all(pts)",
            **{"pts[0]": "refuse"},
        ),
    ],
    "compact-condition": [
        cell(f"{A}\nif get_digital_in(1): {B} end\nmovel({P})", movel__4="refuse"),
        cell(f"{A}\nif get_digital_in(1): {B} else: {B} end\nmovel({P})", movel__4="correct"),
        cell(f"{A}\nmovel({P}); {B}\nmovej({Q})", movel__3="correct", movej__4="correct"),
    ],
    "initial-value": [
        cell(f"w1={P}\nw2=w1\nmovel(w1)\nw2[0]=w2[0]+off\nmovel(w2)", w1="refuse"),
        cell(f"w1={P}\ndef say(w=w1):\ntextmsg(w)\nend\nmovel(w1)\nsay()", w1="refuse"),
        cell(f"def say(v=d2r(10)):\nsleep(v)\nend\nmovel({P})\nsay()", movel__5="correct"),
    ],
    "routine-in-an-expression": [
        cell(
            f"def ask():\n{B}\nreturn x\nend\n{A}\nw1={P}\nmovel(w1)\nif x:\nelif ask():\nelif y:\nmovel(w1)\nend",
            w1="refuse",
        ),
        cell(f"def ask():\nmovel({P})\nreturn True\nend\n{A}\nwhile ask():\n{B}\nend", movel__3="refuse"),
        cell(f"def ask():\n{B}\nreturn True\nend\n{A}\nx=a and ask()\nmovel({P})", movel__8="refuse"),
        cell(f"def speed():\n{B}\nreturn 1\nend\nw1={P}\n{A}\nmovel(w1)\nmovel(w1, v=speed())", w1="refuse"),
        cell(
            f"def speed():\n{B}\nreturn 1\nend\ndef go(v):\nmovel({P}, v=v)\nend\n{A}\ngo(1)\ngo(speed())",
            movel__7="refuse",
        ),
        cell(
            f"w1={P}\ndef n(w):\nreturn w[0]\nend\npts=[{P},{Q}]\nmovel(w1)\nmovel(pts[n(w1)])",
            **{"w1": "refuse", "line 8": "skip"},
        ),
    ],
    "argument-by-name": [
        cell(f"def grip(n):\nif n > 0:\n{B}\nend\nend\n{A}\ngrip(n=1)\nmovel({P})", movel__9="refuse"),
        cell(f"def push(n):\nforce_mode(a,b)\nend\npush(n=1)\nmovel({P})", movel__6="refuse"),
        cell(
            f"def go(w):\nmovel(w)\nend\n{A}\ngo(w={P})\n{B}\ngo(w={Q})",
            go__6_argument_1="refuse",
            go__8_argument_1="refuse",
        ),
        cell(f"movel(v=0.1, pose={P})", movel__2="correct"),
        cell(f"set_tcp(pose=p[0,0,0.1,0,0,0])\nmovel({P})", movel__3="correct"),
    ],
    "optional-argument": [
        cell(f"w1={P}\ndef say(n,w=0):\ntextmsg(w)\nend\nmovel(w1)\nsay(1,w1)", w1="refuse"),
        cell(f"w1={P}\ndef go(n,w=0):\n{B}\nmovel(w)\nend\n{A}\nmovel(w1)\ngo(1,w1)", w1="refuse", movel__5="skip"),
        cell(f"w1={P}\ndef go(n,h=0):\nmovel({Q}, v=h)\nend\nmovel(w1)\ngo(1,w1[2])", w1="refuse", movel__4="correct"),
        cell(f"w1={P}\ndef go(w,v=0.1):\nmovel(w, v=v)\nend\ngo(w1)", w1="correct"),
    ],
    "argument-not-followed": [
        cell(
            f"def go(w):\nmovel(w)\nend\n{A}\nw1={P}\noff=get_actual_tcp_pose()\ngo(w1)\ngo(pose_add(w1,off))",
            w1="refuse",
            go__9_argument_1="skip",
        ),
        cell(f"def go(w):\nmovel(w)\nend\nw1={P}\ngo(w1)\ngo(pose_trans(off,w1))", w1="refuse"),
        cell(f"def go(w):\nmovel(w)\nend\nw1={P}\ngo(w1)\ngo(pose_inv(w1))", w1="refuse"),
        cell(f"def go(w):\nmovel(w)\nend\nw1={P}\ngo(w1)\ngo(pose_trans(w1,p[0,0,0.1,0,0,0.4]))", DERIVED, w1="refuse"),
        cell(f"def go(w):\nmovel(w)\nend\nw1={P}\nw2=pose_add(w1,off)\ngo(w1)\ngo(w2)", w1="refuse"),
        cell(
            f"def go(w):\nmovel(w)\nend\ndef via(u):\ngo(pose_add(u,off))\nend\nw1={P}\nmovel(w1)\nvia(w1)", w1="refuse"
        ),
        cell(f"def go(w):\nmovej(w)\nend\nw1={P}\ngo(w1)\ngo(get_inverse_kin(pose_add(w1,off)))", w1="refuse"),
        cell(f"def go(w):\nmovel(w)\nend\nw1={P}\ngo(w1)\ngo(get_actual_tcp_pose())", w1="correct"),
    ],
    "argument-written": [
        cell(f"w1={P}\ndef lift(w):\nw[2]=w[2]+0.1\nmovel(w)\nend\nmovel(w1)\nlift(w1)", w1="refuse"),
        cell(f"w1={P}\nw1=look(w1)\nmovel(w1)", w1="refuse"),
    ],
    "tool-through-argument": [
        cell(f"def use(t):\nset_tcp(t)\nend\nw1={P}\nmovel(w1)\nuse(w1)", w1="refuse"),
        cell(
            f"def use(t):\nset_tcp(t)\nend\nuse(p[0,0,0.1,0,0,0])\nuse(p[0,0,0.2,0,0,0])\nmovel({P})", movel__7="refuse"
        ),
        cell(f"def use(t):\nset_tcp(t)\nend\ndef both(u):\nuse(u)\nend\nw1={P}\nmovel(w1)\nboth(u=w1)", w1="refuse"),
        cell(f"def use(t):\nset_tcp(t)\nend\nuse(p[0,0,0.1,0,0,0])\nmovel({P})", movel__6="correct"),
    ],
    "continue-in-loop": [
        cell(f"{A}\nwhile True:\nmovel({P})\n{B}\nif x:\ncontinue\nend\n{A}\nend", movel__4="refuse"),
        cell(
            f"while True:\nmovel({P})\ntrack_conveyor_linear(a,b)\nif x:\ncontinue\nend\nstop_conveyor_tracking()\nend",
            movel__3="refuse",
        ),
        cell(f"{A}\nwhile True:\nif x: continue end\nmovel({P})\nend", movel__5="correct"),
    ],
    "inverse-kinematics": [
        cell(f"w1={P}\nw2={Q}\nmovej(get_inverse_kin(w1,[w2[0],0,0,0,0,0]))\nmovel(w2)", w2="refuse"),
        cell(
            f"def x():\n{B}\nreturn 0.1\nend\nw1={P}\n{A}\nmovel(w1)\nq=get_inverse_kin(p[x(),0,0,0,0,0])\nmovel(w1)",
            w1="refuse",
        ),
        cell(f"{A}\nw1={P}\nq=get_inverse_kin(w1)\n{B}\nmovej(q)", w1="refuse"),
        cell(f"def speed():\n{B}\nreturn 1\nend\n{A}\nmovej(get_inverse_kin({P}), v=speed())", movej__7="refuse"),
        cell(f"w1={P}\nq1=[0,-1,1,0,0,0]\nmovej(get_inverse_kin(w1, qnear=q1))", w1="correct"),
    ],
    "chain-of-copies": [
        cell(f"w1={P}\nu=w1\nif x:\nend\nv=u\n{A}\nmovel(v)\n{B}\nmovel(w1)", w1="refuse"),
        cell(f"w1={P}\nu=w1\nv=u\nmovel(w1)\nh=v[2]\nmovel(p[0,0,h,0,0,0])", w1="refuse"),
        cell(f"w1={P}\nw2={Q}\nu=w1\nif x:\nu=w2\nend\nmovel(u)\nmovel(w1)", w1="refuse"),
        cell(f"w1={P}\nu=w1\nv=u\nmovel(v)\nmovel(w1)", w1="correct"),
    ],
    "index-read": [
        cell(f"w1={P}\npts=[{P},{Q}]\nmovel(w1)\nmovel(pts[floor(w1[0])])", w1="refuse"),
        cell(f"w1={P}\nn=[1,2]\nn[w1[0]]=3\nmovel(w1)", w1="refuse"),
        cell(
            f"w1={P}\npts=[{P},{Q}]\nmovel(w1)\npts[w1[0]]=where()\nmovel(pts[0])", w1="refuse", **{"pts[0]": "refuse"}
        ),
    ],
    "arithmetic-on-a-point": [
        cell(f"w1={P}\nw1[2]=w1[2]+0.1\nmovel(w1)", w1="refuse"),
        cell(f"w1={P}\nw1[2]=0.1\nmovel(w1)", w1="skip"),
        cell(f"w1={P}\nu=w1\nu[2]=w1[2]*2\nmovel(w1)\nmovel(u)", DERIVED, w1="refuse"),
        cell(f"w1={P}\nu=w1\nu[2]=u[2]+0.1\nmovel(w1)\nmovel(u)", DERIVED, w1="correct"),
    ],
    "run-time-shift": [
        cell(f"w1={P}\nmovel(w1)\nmovel(pose_add(w1,get_actual_tcp_pose()))", DERIVED, w1="refuse"),
        cell(f"w1={P}\nmovel(w1)\nmovel(pose_trans(w1,p[0,0,h,0,0,0]))", DERIVED, w1="refuse"),
        cell(f"w1={P}\nmovel(w1)\nmovel(pose_add(w1,p[0,0,0.1,0,0,0]))", DERIVED, w1="correct"),
    ],
    "two-frames": [
        cell(f"w1={P}\n{A}\nmovel(w1)\n{B}\nmovel(w1)", w1="refuse"),
        cell(f"w1={P}\nf={Q}\nmovel(w1)\nmovel(pose_trans(f,w1))", w1="refuse"),
        cell(f"w1={P}\ndef go():\nmovel(w1)\nend\n{A}\ngo()\n{B}\ngo()", w1="refuse"),
    ],
    "sensor-shift": [
        cell(
            f"path_offset_enable()\nmovel({P})\npath_offset_disable()\nmovel({Q})",
            movel__3="refuse",
            movel__5="correct",
        ),
        cell(f"if x:\nforce_mode(a,b)\nend\nmovel({P})", movel__5="refuse"),
        cell(f"x=a or force_mode(f,b,c,d,e)\nmovel({P})", movel__3="refuse"),
        urp("MOVE<Script>track_conveyor_linear(p[1,0,0,0,0,0], 500)</Script>", "refuse"),
    ],
    "alias": [
        cell(f"w1={P}\nu=w1\nmovel(w1)\ntell(u)", w1="refuse"),
        cell(f"f={Q}\ng=f\ng[2]=h\nmovel(pose_trans(g,{P}))", movel__5="skip"),
        cell(f"t=p[0,0,0.1,0,0,0]\nu=t\nset_tcp(u)\nmovel({P})", movel__5="correct"),
    ],
    "recursion": [
        cell(f"def go(n):\nmovel({P})\n{B}\nif n > 0:\ngo(n-1)\nend\nend\n{A}\ngo(3)", movel__3="refuse"),
        cell(f"def go(w,n):\nmovel(w)\nif n > 0:\ngo(pose_add(w,off),n-1)\nend\nend\nw1={P}\ngo(w1,3)", w1="refuse"),
        cell(f"def go(n):\nmovel({P})\nif n > 0:\ngo(n-1)\nend\nend\n{A}\ngo(3)", movel__3="correct"),
    ],
    "unreachable-code": [
        cell(f"{A}\nmovel({P})\nhalt\n{B}\nmovel({Q})", movel__3="correct"),
        cell(f"{A}\nif x:\nhalt\n{B}\nend\nmovel({P})", movel__7="correct"),
        cell(f"{A}\nwhile True:\nif x:\nbreak\n{A}\nend\n{B}\nend\nmovel({P})", movel__10="refuse"),
        cell(
            f"def go(w):\n{B}\nmovel({Q})\nend\ndef go(w):\n{A}\nmovel(w)\nend\ngo({P})",
            movel__4="skip",
            go__10_argument_1="correct",
        ),
    ],
    "state-across-calls": [
        cell(f"def one():\n{B}\nend\ndef two():\none()\nend\nw1={P}\n{A}\nmovel(w1)\ntwo()\nmovel(w1)", w1="refuse"),
        cell(f"def one():\nforce_mode(a,b)\nend\ndef two():\none()\nend\ntwo()\nmovel({P})", movel__9="refuse"),
        cell(f"def one():\nif x:\nreturn 0\nend\n{B}\nend\n{A}\none()\nmovel({P})", movel__10="refuse"),
        urp(
            "MOVE<Script>use()</Script><SubProgram><children><Script>def use():\nset_tcp(t)\nend"
            "</Script></children></SubProgram>",
            "refuse",
        ),
    ],
}
ABSENT: dict[str, str] = {
    "error-leaves-a-routine": "an error stops the program; the language has no error handlers",
    "routine-in-a-motion": "a motion names no routine; functions in its arguments run before it",
}

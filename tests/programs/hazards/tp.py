"""FANUC TP: programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell

from truepose.programs import ReadOptions

WHOLE = ReadOptions(whole_task=True)
DERIVED = ReadOptions(whole_task=True, derived=True)


def program(name: str, *code: str, uf: str = "1", ut: str = "1") -> str:
    """Return a program with the positions P[1] to P[3]."""
    lines = "".join(f"{k:>4}:{line} ;\n" for k, line in enumerate(code, 1))
    positions = "".join(
        f"P[{k}]{{\n   GP1:\n\tUF : {uf}, UT : {ut},\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX =   {500 + 50 * k}.000  mm,\tY =   -40.250  mm,\tZ =   {900 + k}.500  mm,\n"
        f"\tW =  -180.000 deg,\tP =      .000 deg,\tR =    90.000 deg\n}};\n"
        for k in (1, 2, 3)
    )
    head = f'/PROG  {name}\n/ATTR\nOWNER\t\t= MNEDITOR;\nCOMMENT\t\t= "";\nDEFAULT_GROUP\t= 1,*,*,*,*;\n'
    return f"{head}CONTROL_CODE\t= 00000000 00000000;\n/MN\n{lines}/POS\n{positions}/END\n"


def cell(
    *code: str,
    uf: str = "1",
    ut: str = "1",
    others: dict[str, tuple[str, ...]] | None = None,
    options: ReadOptions | None = None,
    fault: str = "",
    **wanted: str,
) -> Cell:
    """Return a cell of the program MAIN, with other programs in its folder; ``p1="correct"`` is the verdict of P[1]."""
    files = {"MAIN.LS": program("MAIN", *code, uf=uf, ut=ut)}
    files |= {f"{name}.LS": program(name, *more) for name, more in (others or {}).items()}
    verdicts = {f"P[{name[1:]}]": verdict for name, verdict in wanted.items()}
    return Cell(files, verdicts, options or ReadOptions(), fault=fault)


def go(k: int, tail: str = "") -> str:
    return f"L P[{k}] 100mm/sec FINE{tail}"


FRAME, TOOL = "  UFRAME_NUM=1", "  UTOOL_NUM=1"
OTHER_TOOL = "  UTOOL_NUM=2"
COPY = "  PR[1]=P[1]"
HEIGHT = "  R[1]=PR[1,3]"

CELLS: dict[str, list[Cell]] = {
    "unknown-statement": [
        cell(FRAME, "  CLOSE_GRIPPER", go(1), uf="F", p1="refuse"),
        cell(FRAME, go(1), "  Open hand 1", go(2), uf="F", p1="correct", p2="refuse"),
        cell(COPY, "  Fixture clamp", "L PR[1] 100mm/sec FINE", go(1), options=WHOLE, p1="refuse"),
        cell(FRAME, "  QQSEND P[1]", go(1), go(2), p1="refuse", p2="correct"),
        cell(TOOL, "  Spot[SD=1,P=1,t=1.0]", "  Arc Start[1]", go(1), "  Arc End[1]", p1="correct"),
    ],
    "coordinate-in-number": [
        cell(
            COPY, HEIGHT, "  IF R[1]>500,JMP LBL[1]", go(2), "  LBL[1]", go(1), options=WHOLE, p1="refuse", p2="correct"
        ),
        cell(COPY, "  R[1]=PR[1,3]*2+R[5]", "  AO[1]=R[1]", go(1), options=WHOLE, p1="refuse"),
        cell(COPY, HEIGHT, "  SELECT R[1]=900,JMP LBL[1]", "  LBL[1]", go(1), options=DERIVED, p1="refuse"),
        cell(COPY, "  IF (PR[1,3]>500 AND DI[1]),JMP LBL[1]", "  LBL[1]", go(1), options=WHOLE, p1="refuse"),
        cell(
            COPY,
            "  PR[2]=PR[1]",
            "  R[1]=PR[2,3]",
            "  R[2]=R[1]",
            "  CALL GRIP(R[2])",
            go(1),
            options=DERIVED,
            p1="refuse",
        ),
        cell("  R[1]=R[2]+5", "  IF R[1]>500,JMP LBL[1]", go(2), "  LBL[1]", go(1), p1="correct", p2="correct"),
    ],
    "coordinate-in-frame": [
        cell(COPY, "  UFRAME[5]=PR[1]", go(1), options=DERIVED, p1="refuse"),
        cell(COPY, HEIGHT, "  $MNUFRAME[1,5].$X=R[1]", go(1), options=DERIVED, p1="refuse"),
        cell(COPY, "  PR[3,1]=PR[1,1]", go(2, " Offset,PR[3]"), go(1), options=DERIVED, p1="refuse", p2="skip"),
    ],
    "expression-in-modifier": [
        cell(COPY, HEIGHT, "L P[2] R[1]mm/sec FINE", go(1), options=DERIVED, p1="refuse", p2="correct"),
        cell(COPY, go(2, " TA .1sec,CALL SIGNAL(PR[1,3])"), go(1), options=WHOLE, p1="refuse"),
        cell(go(2, " Skip,LBL[1],PR[5]=LPOS"), go(1), "  LBL[1]", options=WHOLE, p1="correct", p2="correct"),
    ],
    "called-program-shifts": [
        cell(go(1), "  CALL SEAM", go(2), others={"SEAM": ("  Track TAST[1]",)}, p1="correct", p2="refuse"),
        cell(
            go(1), "  CALL SEAM", go(2), others={"SEAM": ("  Track TAST[1]", "  Track End")}, p1="correct", p2="correct"
        ),
        cell(go(1), "  CALL SOFT", go(2), others={"SOFT": ("  SOFTFLOAT[1]",)}, p1="correct", p2="refuse"),
    ],
    "called-program-sets-frame": [
        cell(FRAME, "  CALL FIX", go(1), uf="F", others={"FIX": ("  UFRAME_NUM=2",)}, p1="refuse"),
        cell(FRAME, "  CALL FIX", go(1), others={"FIX": ("  UFRAME_NUM=2",)}, p1="correct"),
    ],
    "handler-changes-state": [
        cell(FRAME, "  MONITOR WATCH", go(1), go(2), uf="F", p1="refuse", p2="refuse"),
        cell("  MONITOR WATCH", COPY, "L PR[1] 100mm/sec FINE", go(1), options=WHOLE, p1="refuse"),
        cell("  MONITOR WATCH", go(1), "  MONITOR END WATCH", p1="correct"),
        cell(FRAME, "  RUN BESIDE", go(1), uf="F", p1="refuse"),
    ],
    "certain-loop": [
        cell("  FOR R[1]=1 TO 3", OTHER_TOOL, "  ENDFOR", go(1), p1="refuse"),
        cell("  FOR R[1]=3 DOWNTO 3", "  UFRAME_NUM=2", go(2), "  ENDFOR", go(1), p1="refuse", p2="refuse"),
        cell("  FOR R[1]=1 TO 2", "  FOR R[2]=0 TO 0", OTHER_TOOL, "  ENDFOR", "  ENDFOR", go(1), p1="refuse"),
        cell("  FOR R[1]=1 TO R[2]", OTHER_TOOL, "  ENDFOR", go(1), p1="correct"),
        cell("  FOR R[1]=1 TO 3", TOOL, "  ENDFOR", go(1), ut="F", p1="correct"),
        cell(TOOL, "  FOR R[1]=1 TO R[2]", OTHER_TOOL, "  ENDFOR", go(1), ut="F", p1="refuse"),
        cell(TOOL, "  FOR R[1]=2 TO 1", OTHER_TOOL, "  ENDFOR", go(1), p1="correct"),
    ],
    "conditional-frame": [
        cell(TOOL, "  IF (DI[1]=ON) THEN", OTHER_TOOL, "  ENDIF", go(1), ut="F", p1="refuse"),
        cell(TOOL, "  IF (DI[1]=ON) THEN", OTHER_TOOL, "  ELSE", OTHER_TOOL, "  ENDIF", go(1), p1="refuse"),
        cell(TOOL, "  IF (DI[1]=ON) THEN", OTHER_TOOL, "  ENDIF", go(1), p1="correct"),
    ],
    "routine-like-a-motion": [
        cell(FRAME, "  L_HOME", go(1), uf="F", p1="refuse"),
        cell(COPY, "  CALL L", go(1), options=WHOLE, p1="refuse"),
        cell("  CALL J(1)", go(1), others={"J": ("  Track TAST[1]",)}, p1="refuse"),
    ],
    "array-element": [
        cell("  R[1]=2", "L P[R[1]] 100mm/sec FINE", FRAME, OTHER_TOOL, go(1), p1="refuse"),
        cell("  PR[R[1]]=P[1]", "L PR[2] 100mm/sec FINE", go(1), options=WHOLE, p1="refuse"),
        cell("  P[R[1]]=PR[3]", go(1), go(2), p1="skip", p2="skip"),
    ],
    "whole-array": [
        cell(COPY, "  PR[2]=PR[1]", "L PR[2] 100mm/sec FINE", go(1), options=WHOLE, p1="refuse"),
        cell(COPY, "  PR[2]=PR[1]", "  UFRAME[5]=PR[2]", go(1), options=DERIVED, p1="refuse"),
    ],
    "compact-condition": [
        cell(FRAME, "  IF (DI[1]),UFRAME_NUM=2", go(1), uf="F", p1="refuse"),
        cell("  IF (DI[1]),UTOOL_NUM=2", go(1), p1="correct"),
        cell(COPY, "  IF (DI[1]),PR[1]=PR[2]", "L PR[1] 100mm/sec FINE", go(1), options=WHOLE, p1="refuse"),
        cell(FRAME, "  IF DI[1]=ON,CALL FIX", go(1), uf="F", p1="refuse"),
    ],
    "routine-in-a-motion": [
        cell(FRAME, go(1, " TB .5sec,CALL FIX"), go(2), uf="F", p1="correct", p2="refuse"),
        cell(COPY, go(2, " DB 10mm,CALL FIX"), "L PR[1] 100mm/sec FINE", options=WHOLE, p2="correct", p1="skip"),
        cell(go(1), go(2, " TA .1sec,DO[1]=ON"), p1="correct", p2="correct"),
    ],
    "argument-not-followed": [
        cell(COPY, "  CALL FIX(PR[1,3])", go(1), options=DERIVED, p1="refuse"),
        cell(COPY, HEIGHT, "  CALL FIX(R[1],'a')", go(1), options=DERIVED, p1="refuse"),
        cell("  CALL FIX(1,R[1])", go(1), p1="correct"),
    ],
    "argument-written": [
        cell(COPY, "  CALL FIX(1)", "L PR[1] 100mm/sec FINE", go(1), options=WHOLE, p1="refuse"),
        cell("  PR[1,3]=50", "  CALL FIX(1)", go(1, " Offset,PR[1]"), go(2), options=DERIVED, p1="skip", p2="correct"),
    ],
    "tool-through-argument": [
        cell("  UTOOL_NUM=AR[1]", go(1), ut="F", p1="refuse"),
        cell("  UTOOL_NUM=AR[1]", go(1), p1="correct"),
        cell("  UTOOL[AR[1]]=PR[5]", go(1), p1="refuse"),
    ],
    "continue-in-loop": [
        cell(
            FRAME,
            "  FOR R[1]=1 TO 3",
            "  UFRAME_NUM=2",
            "  IF DI[1]=ON,JMP LBL[1]",
            FRAME,
            "  LBL[1]",
            go(1),
            "  ENDFOR",
            uf="F",
            p1="refuse",
        ),
        cell(
            TOOL,
            "  FOR R[1]=1 TO 3",
            "  IF DI[1]=ON,JMP LBL[1]",
            OTHER_TOOL,
            "  ENDFOR",
            "  LBL[1]",
            go(1),
            ut="F",
            p1="refuse",
        ),
        cell("  FOR R[1]=1 TO 3", "  IF DI[1]=ON,JMP LBL[1]", OTHER_TOOL, "  ENDFOR", "  LBL[1]", go(1), p1="correct"),
    ],
    "chain-of-copies": [
        cell(
            COPY,
            "  PR[2]=PR[1]",
            "  IF (DI[1]) THEN",
            "  PR[3]=PR[2]",
            "  ENDIF",
            "  UFRAME[5]=PR[3]",
            go(1),
            options=DERIVED,
            p1="refuse",
        ),
        cell(
            COPY,
            "  PR[2]=PR[1]",
            "  IF (DI[1]) THEN",
            "  ENDIF",
            "  PR[3]=PR[2]",
            "  R[1]=PR[3,1]",
            "  AO[1]=R[1]",
            go(1),
            options=WHOLE,
            p1="refuse",
        ),
    ],
    "index-read": [
        cell(COPY, "  R[1]=PR[1,3]", "L P[R[1]] 100mm/sec FINE", go(1), options=DERIVED, p1="refuse"),
        cell(COPY, "  R[1]=PR[1,3]", "  CALL FIX(R[1])", "  PR[R[1]]=PR[5]", go(1), options=WHOLE, p1="refuse"),
    ],
    "arithmetic-on-a-point": [
        cell(COPY, "  PR[1,3]=PR[1,3]*2", "L PR[1] 100mm/sec FINE", go(1), options=DERIVED, p1="refuse"),
        cell(
            COPY,
            "  PR[2]=P[2]",
            "  PR[1,1]=PR[2,3]",
            "L PR[1] 100mm/sec FINE",
            go(1),
            go(2),
            options=DERIVED,
            p1="refuse",
            p2="refuse",
        ),
    ],
    "run-time-shift": [
        cell(go(1, " Offset,PR[5]"), go(2), p1="skip", p2="correct"),
        cell(COPY, "  PR[1,3]=PR[1,3]+R[7]", "L PR[1] 100mm/sec FINE", go(1), options=DERIVED, p1="refuse"),
        cell("  OFFSET CONDITION PR[5]", go(1, " Offset"), go(2), p1="skip", p2="correct"),
        cell(go(1, " VOFFSET,VR[1]"), go(1), p1="refuse"),
    ],
    "two-frames": [
        cell("  UFRAME_NUM=2", go(1), "  UFRAME_NUM=1", go(2), p1="refuse", p2="correct"),
        cell("  UFRAME_NUM=1", go(1), "  UFRAME_NUM=2", go(1), uf="F", p1="refuse"),
        cell(FRAME, TOOL, COPY, "  UFRAME_NUM=2", "L PR[1] 100mm/sec FINE", FRAME, go(1), options=DERIVED, p1="refuse"),
    ],
    "sensor-shift": [
        cell("  Track TAST[1]", go(1), "  Track End", go(2), p1="refuse", p2="correct"),
        cell("  Touch Offset PR[5]", go(1), "  Touch Offset End", go(2), p1="refuse", p2="correct"),
        cell("  Search Start[1] PR[5]", go(1, " Search[X]"), "  Search End", go(2), p1="skip", p2="correct"),
    ],
    "alias": [
        cell(
            "  PR[1:pick]=P[1:above]",
            "  R[1]=PR[1:other,3]",
            "  IF R[1:z]>5,JMP LBL[1]",
            "  LBL[1]",
            go(1),
            options=WHOLE,
            p1="refuse",
        ),
        cell("L P[1:above] 100mm/sec FINE", "L P[1] 100mm/sec FINE", p1="correct"),
    ],
    "recursion": [
        cell(FRAME, go(1), "  UFRAME_NUM=2", "  CALL MAIN", go(2), uf="F", p1="correct", p2="refuse"),
        cell(FRAME, go(1), "  CALL MAIN", go(2), p1="correct", p2="correct"),
    ],
    "unreachable-code": [
        cell("  JMP LBL[1]", OTHER_TOOL, "  LBL[1]", go(1), p1="correct"),
        cell("  JMP LBL[1]", "  LBL[2]", "  Track TAST[1]", "  LBL[1]", go(1), "  JMP LBL[2]", p1="refuse"),
        cell(TOOL, "  END", OTHER_TOOL, go(1), p1="correct"),
    ],
    "state-across-calls": [
        Cell(
            {
                "PICK.LS": program("PICK", "  SOFTFLOAT[1]", "  CALL MAIN", go(1)),
                "MAIN.LS": program("MAIN", "  DO[1]=ON"),
            },
            {"P[1]": "refuse"},
        ),
        cell("  CALL OUTER", go(1), others={"OUTER": ("  CALL INNER",), "INNER": ("  Track TAST[1]",)}, p1="refuse"),
        cell(
            COPY,
            "  CALL OUTER",
            "L PR[1] 100mm/sec FINE",
            others={"OUTER": ("  CALL INNER",), "INNER": ("  PR[1]=PR[5]",)},
            options=DERIVED,
            p1="skip",
        ),
        cell(FRAME, "  CALL OUTER", go(1), uf="F", others={"OUTER": ("  CALL INNER",)}, p1="refuse"),
    ],
}
ABSENT: dict[str, str] = {
    "coordinate-in-position": "a motion names a position, it does not contain numbers of one",
    "frame-written-by-call": "arguments are handed over by value; what any program writes to a frame counts everywhere",
    "error-leaves-a-routine": "an error pauses the program; no instruction handles it",
    "initial-value": "positions under /POS are numbers",
    "routine-in-an-expression": "an expression cannot call a program",
    "argument-by-name": "arguments have no names",
    "optional-argument": "arguments have no default values",
    "inverse-kinematics": "only programs in KAREL convert between joints and positions, which count as unknown calls",
}

"""Yaskawa INFORM: programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell

from truepose.programs import ReadOptions

WHOLE = ReadOptions(whole_task=True)
DERIVED = ReadOptions(whole_task=True, derived=True)
_XYZ = ",50.000,20.000,180.0000,0.0000,0.0000"


def job(name: str, *code: str, variables: tuple[int, ...] = (), postype: str = "USER\n///USER 1") -> str:
    """Return a job with the positions C00000 to C00002 and some P variables."""
    c = [f"C{k:05}={100 + 60 * k}.000{_XYZ}" for k in range(3)]
    p = [f"P{k:05}={200 + 10 * k}.000{_XYZ}" for k in variables]
    head = ["/JOB", f"//NAME {name}", "//POS", f"///NPOS 3,0,0,{len(p)},0,0", "///TOOL 1", f"///POSTYPE {postype}"]
    middle = ["///RECTAN", "///RCONF 0,0,0,0,0,0,0,0", *c, *p, "//INST", "///DATE 2024/05/06 10:00", "///ATTR SC,RW,RJ"]
    return "\r\n".join([*head, *middle, "////FRAME USER 1", "///GROUP1 RB1", "NOP", *code, "END", ""])


def cell(
    *code: str, others: dict[str, str] | None = None, options: ReadOptions | None = None, fault: str = "", **wanted: str
) -> Cell:
    """Return a cell of job MAIN, with other jobs in its folder."""
    variables = tuple([int(name[1:]) for name in wanted if name[0] == "P"])
    files = {"MAIN.JBI": job("MAIN", *code, variables=variables), **(others or {})}
    return Cell(files, wanted, options or ReadOptions(), fault=fault)


FIRST, SECOND, THIRD = (f"MOVL C0000{k} V=50.0" for k in range(3))
SHIFTING = {"SIDE.JBI": job("SIDE", "SFTON P010 UF#(1)")}

CELLS: dict[str, list[Cell]] = {
    "unknown-statement": [
        cell(FIRST, "QQTRACK P002 UF#(1) 5", SECOND, C00000="refuse", C00001="refuse"),
        cell(FIRST, "QQPATH JOB:SIDE", SECOND, others=SHIFTING, C00000="correct", C00001="skip"),
        cell(FIRST, "QQREAD C00001", SECOND, C00000="correct", C00001="refuse"),
        cell(FIRST, "HPVELON", "ARCON ASF#(3)", "WVON WEV#(1)", SECOND, "WVOF", C00000="correct", C00001="correct"),
    ],
    "coordinate-in-number": [
        cell("MOVL P001 V=50.0", "GETE D000 P001 (3)", "DOUT OG#(1) D000", options=WHOLE, P00001="skip"),
        cell("GETPOS PX020 STEP#(1)", FIRST, "GETE D000 P020 (3)", "JUMP *A IF D000>5", SECOND, "*A", C00000="refuse"),
    ],
    "coordinate-in-frame": [
        cell(FIRST, "MFRAME UF#(5) C00000 C00001 C00002", SECOND, C00000="refuse", C00001="refuse"),
        cell("MOVL P001 V=50.0", "MFRAME UF#(5) P001 P002 P003", options=WHOLE, P00001="skip"),
        cell("GETPOS PX001 STEP#(1)", "MFRAME UF#(5) PX001 PX002 PX003", FIRST, C00000="refuse"),
    ],
    "expression-in-modifier": [
        cell("MOVL C00000 V=50.0 QQ C00001", SECOND, C00000="correct", C00001="refuse"),
        cell("MOVL P001 V=5.0", "MOVL C00000 V=50.0 QQ P001", options=WHOLE, C00000="correct", P00001="refuse"),
        cell("MOVL C00000 V=50.0 PL=0 ACC=20 DEC=20 UNTIL IN#(1)=ON", C00000="correct"),
    ],
    "called-program-shifts": [
        cell(FIRST, "CALL JOB:SIDE", SECOND, others=SHIFTING, C00000="correct", C00001="skip"),
        cell(FIRST, "CALL JOB:SIDE IF IN#(3)=ON", SECOND, others=SHIFTING, C00000="correct", C00001="skip"),
        cell(
            *(FIRST, "CALL JOB:SIDE", SECOND),
            others={"SIDE.JBI": job("SIDE", "SYSTART CV#(1) STP=10.0")},
            C00000="correct",
            C00001="refuse",
        ),
        cell(
            *(FIRST, "CALL JOB:SIDE", "SFTOF", SECOND),
            others={"SIDE.JBI": job("SIDE", "SYSTART CV#(1) STP=10.0")},
            C00000="correct",
            C00001="refuse",
        ),
        cell(
            *(FIRST, "CALL JOB:SIDE", SECOND),
            others={"SIDE.JBI": job("SIDE", "SFTON P010", THIRD, "SFTOF")},
            C00000="correct",
            C00001="correct",
        ),
        Cell(
            {"SIDE.JBI": job("SIDE", FIRST), "MAIN.JBI": job("MAIN", "SFTON P010", "CALL JOB:SIDE", "SFTOF")},
            {"C00000": "skip"},
        ),
    ],
    "called-program-sets-frame": [
        cell(
            *(FIRST, "CALL JOB:SIDE", SECOND),
            others={"SIDE.JBI": job("SIDE", "MFRAME UF#(1) P001 P002 P003")},
            C00000="refuse",
            C00001="refuse",
        ),
        cell(FIRST, "CALL JOB:SIDE", others={"SIDE.JBI": job("SIDE", "SETTOOL TL#(1) P001")}, C00000="refuse"),
        cell(FIRST, "CALL JOB:SIDE", others={"SIDE.JBI": job("SIDE", "SETTOOL TL#(2) P001")}, C00000="correct"),
    ],
    "handler-changes-state": [
        cell("PSTART JOB:SIDE SUB1", FIRST, "PWAIT SUB1", others=SHIFTING, C00000="skip"),
        cell(
            "PSTART JOB:SIDE SUB1",
            FIRST,
            others={"SIDE.JBI": job("SIDE", "CALL JOB:DEEP"), "DEEP.JBI": job("DEEP", "SFTON P010")},
            C00000="skip",
        ),
    ],
    "certain-loop": [
        cell("FOR I000=1 TO 3", "SFTON P010", "NEXT I000", FIRST, C00000="skip"),
        cell("SFTON P010", "FOR I000=1 TO 3", "SFTOF", "NEXT I000", FIRST, C00000="skip"),
        cell("FOR I000=1 TO 3", "SFTON P010", SECOND, "SFTOF", FIRST, "NEXT I000", C00000="correct", C00001="skip"),
    ],
    "conditional-frame": [
        cell("IFTHENEXP IN#(1)=ON", "MFRAME UF#(1) P001 P002 P003", "ENDIF", FIRST, C00000="refuse"),
        cell("IFTHENEXP IN#(1)=ON", "SFTON P010", "ENDIF", FIRST, C00000="skip"),
        cell("IFTHENEXP IN#(1)=ON", "SFTON P010", "ELSE", FIRST, "ENDIF", C00000="correct"),
    ],
    "frame-written-by-call": [
        cell(FIRST, "SETTOOL TL#(1) P001", SECOND, C00000="refuse", C00001="refuse"),
        cell(FIRST, "SETTOOL TL#(B000) P001", C00000="refuse"),
        cell(FIRST, "GETTOOL PX001 TL#(1)", C00000="correct"),
    ],
    "routine-like-a-motion": [
        cell(FIRST, "CALL JOB:MOVL1", SECOND, others={"MOVL1.JBI": job("MOVL1", "SFTON P010")}, C00001="skip"),
        cell(FIRST, "CALL JOB:SFTON", SECOND, others={"SFTON.JBI": job("SFTON", THIRD)}, C00001="correct"),
    ],
    "array-element": [
        cell("SET P[I000] P002", "MOVL P001 V=50.0", FIRST, options=WHOLE, C00000="correct", P00001="refuse"),
        cell("MOVL P[I000] V=50.0", "MOVL P001 V=50.0", options=WHOLE, P00001="refuse"),
        cell("SFTON P010", "MOVL P[I000] V=50.0", "SFTOF", "MOVL P001 V=50.0", options=WHOLE, P00001="refuse"),
    ],
    "whole-array": [
        cell("MOVL P001 V=50.0", "CLEAR P000 ALL", options=WHOLE, P00001="refuse"),
        cell("MOVL P001 V=50.0", "SET P002 P001", "MOVL P002 V=50.0", options=WHOLE, P00001="skip"),
    ],
    "compact-condition": [
        cell("SFTON P010", "JUMP *A IF IN#(1)=ON", "SFTOF", "*A", FIRST, C00000="skip"),
        cell("IF IN#(1)=ON JUMP *A", "SFTON P010", "*A", FIRST, C00000="skip"),
        cell("SFTON P010", "RET IF IN#(1)=ON", "SFTOF", FIRST, C00000="correct"),
        Cell(
            {
                "MAIN.JBI": job("MAIN", FIRST, "CALL JOB:SIDE", SECOND),
                "SIDE.JBI": job("SIDE", "SFTON P010", "RET IF IN#(1)=ON", "SFTOF"),
            },
            {"C00000": "correct", "C00001": "skip"},
        ),
    ],
    "argument-not-followed": [
        cell("MOVL P001 V=50.0", "CALL JOB:SIDE ARGFP001", options=WHOLE, P00001="skip"),
        cell("GETE D000 P001 (1)", "CALL JOB:SIDE ARGFD000", "MOVL P001 V=50.0", options=WHOLE, P00001="skip"),
    ],
    "argument-written": [
        cell(
            *("CALL JOB:SIDE ARGFP001", "MOVL P001 V=50.0", FIRST),
            others={"SIDE.JBI": job("SIDE", "GETARG PX002 IARG#(1)", "ADD P002 P003")},
            options=WHOLE,
            P00001="skip",
            C00000="correct",
        ),
    ],
    "continue-in-loop": [
        cell("FOR I000=1 TO 3", "SFTON P010", "JUMP *N IF IN#(1)=ON", "SFTOF", "*N", FIRST, "NEXT I000", C00000="skip"),
        cell("*A", FIRST, "SFTON P010", "JUMP *A IF IN#(1)=ON", "SFTOF", SECOND, C00000="skip", C00001="correct"),
    ],
    "inverse-kinematics": [
        cell("MOVL P001 V=50.0", "CNVRT PX002 PX001 PULSE", "MOVJ P002 VJ=5.0", options=WHOLE, P00001="skip"),
    ],
    "chain-of-copies": [
        cell(
            *("SET P002 P001", "IFTHENEXP IN#(1)=ON", "SET P003 P002", "ENDIF", "MOVL P003 V=50.0"),
            options=WHOLE,
            P00001="skip",
        ),
        cell(
            "SET P002 P001",
            "ADD P003 P002",
            "SFTON P003",
            FIRST,
            "SFTOF",
            "MOVL P001 V=5.0",
            C00000="skip",
            P00001="skip",
            options=WHOLE,
        ),
    ],
    "index-read": [
        cell("GETE D000 P001 (1)", "SET I000 D000", "MOVL P[I000] V=50.0", options=WHOLE, P00001="skip"),
        cell("GETE D000 P001 (1)", "SET I000 D000", "CALL IG#(I000)", "MOVL P001 V=9.0", options=WHOLE, P00001="skip"),
    ],
    "arithmetic-on-a-point": [
        cell("SETE P001 (3) 50000", "MOVL P001 V=50.0", options=WHOLE, P00001="skip"),
        cell("ADD P001 P002", "MOVL P001 V=50.0", FIRST, options=WHOLE, P00001="skip", C00000="correct"),
    ],
    "run-time-shift": [
        cell("GETS PX010 $PX000", "SFTON P010 UF#(1)", FIRST, "SFTOF", SECOND, C00000="skip", C00001="correct"),
        cell("GETS PX010 $PX000", "SFTON P010 UF#(1)", FIRST, "SFTOF", options=DERIVED, C00000="skip"),
        cell("SFTON P010 UF#(1)", FIRST, "SFTOF", FIRST, C00000="refuse"),
    ],
    "two-frames": [
        cell(FIRST, "MOVL C00000 V=50.0 UF#(2)", SECOND, C00000="refuse", C00001="correct"),
        cell(FIRST, "MOVL C00000 V=50.0 TL#(2)", C00000="refuse"),
        Cell(
            {"SIDE.JBI": job("SIDE", FIRST), "MAIN.JBI": job("MAIN", "CALL JOB:SIDE UF#(2)")},
            {"C00000": "skip"},
        ),
    ],
    "sensor-shift": [
        cell("SYSTART CV#(1) STP=10.0", FIRST, "SYEND CV#(1)", SECOND, C00000="refuse", C00001="correct"),
        cell("COMARCON #(1)", FIRST, "COMARCOF", SECOND, C00000="refuse", C00001="correct"),
        cell(
            "FLOATON FL#(1)", FIRST, "JUMP *A IF IN#(1)=ON", "FLOATOF", "*A", SECOND, C00000="refuse", C00001="refuse"
        ),
    ],
    "alias": [
        cell("MOVL P001 V=50.0", "GETE D000 PX001 (3)", options=WHOLE, P00001="skip"),
        cell("MOVL C0000 V=50.0", "REFP 1 C00000", C00000="refuse"),
    ],
    "recursion": [
        cell(FIRST, "SFTON P010", "CALL JOB:MAIN IF IN#(1)=ON", "SFTOF", SECOND, C00000="skip", C00001="correct"),
        cell(FIRST, "CALL JOB:MAIN IF IN#(1)=ON", SECOND, C00000="correct", C00001="correct"),
    ],
    "unreachable-code": [
        cell(FIRST, "JUMP *A", "SFTON P010", "*A", SECOND, C00000="correct", C00001="correct"),
        cell(FIRST, "JUMP *A", "*B", "SFTON P010", "*A", SECOND, "JUMP *B IF IN#(1)=ON", C00001="skip"),
        cell(
            "COMM SFTON P010", FIRST, "COMM SFTOF", "SFTON P010", "COMM SFTOF", SECOND, C00000="correct", C00001="skip"
        ),
    ],
    "state-across-calls": [
        cell(
            *(FIRST, "CALL JOB:SIDE", SECOND),
            others={"SIDE.JBI": job("SIDE", "CALL JOB:DEEP", THIRD), "DEEP.JBI": job("DEEP", "SFTON P010")},
            C00000="correct",
            C00001="skip",
        ),
        Cell(
            {
                "DEEP.JBI": job("DEEP", FIRST),
                "SIDE.JBI": job("SIDE", "CALL JOB:DEEP"),
                "MAIN.JBI": job("MAIN", "SFTON P010", "CALL JOB:SIDE", "SFTOF"),
            },
            {"C00000": "skip"},
        ),
        cell(
            *("SFTON P010 UF#(1)", "CALL JOB:SIDE", FIRST, "SFTOF"),
            others={"SIDE.JBI": job("SIDE", "SFTOF")},
            C00000="skip",
        ),
    ],
}
ABSENT: dict[str, str] = {
    "coordinate-in-position": "a motion names a position, it does not contain numbers of one",
    "initial-value": "positions under //POS are numbers",
    "routine-in-an-expression": "there are no functions",
    "routine-in-a-motion": "a motion names no job",
    "error-leaves-a-routine": "an error stops the robot; no instruction handles it",
    "argument-by-name": "arguments have no names",
    "optional-argument": "arguments have no default values",
    "tool-through-argument": "tools and user frames are no arguments",
}

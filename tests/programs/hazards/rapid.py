"""Programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell

from truepose.programs import ReadOptions

_HEAD = """MODULE cell
PERS tooldata tGun:=[TRUE,[[0,0,120],[1,0,0,0]],[2,[0,0,60],[1,0,0,0],0,0,0]];
PERS wobjdata wobA:=[FALSE,TRUE,"",[[850,-200,300],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
PERS wobjdata wobB:=[FALSE,TRUE,"",[[950,-200,300],[0,0,0,1]],[[0,0,0],[1,0,0,0]]];
VAR robtarget pNow;
VAR num nUp:=5;
VAR num nAt:=1;
VAR num nList{2}:=[1,2];
VAR bool ok;
VAR string stText:="";
VAR pose pseOff:=[[0,0,30],[1,0,0,0]];
VAR rawbytes rbData;
VAR corrdescr idCorr;
VAR intnum irStop;
"""
_SHIFT = "PDispSet [[0,0,30],[1,0,0,0]];"
_WAIT = "WaitDI diReady,1\\MaxTime:=1;"


def _target(x: int) -> str:
    return f"[[{x},50,20],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def _to(point: str, wobj: str = "wobA", word: str = "MoveL") -> str:
    return f"{word} {point},v200,fine,tGun\\WObj:={wobj};"


def _files(main: str, more: str = "", data: str = "") -> dict[str, str]:
    points = "".join(f"CONST robtarget p{k}:={_target(100 * k)};\n" for k in (1, 2))
    points += f"VAR robtarget pMany{{2}}:=[{_target(610)},\n{_target(620)}];\n"
    points += f"CONST robtarget pFixed{{2}}:=[{_target(710)},\n{_target(720)}];\n"
    return {"cell.mod": f"{_HEAD}{points}{data}\nPROC main()\n{main}\nENDPROC\n{more}\nENDMODULE\n"}


def _cell(main: str, more: str = "", data: str = "", *, derived: bool = False, fault: str = "", **wanted: str) -> Cell:
    """Return a program of one module that is the whole task; an element of an array is written ``pMany_1``."""
    named = {f"{name.replace('_', '{')}}}" if "_" in name else name: verdict for name, verdict in wanted.items()}
    return Cell(_files(main, more, data), named, ReadOptions(whole_task=True, derived=derived), fault=fault)


def _proc(name: str, body: str, parameters: str = "") -> str:
    return f"PROC {name}({parameters})\n{body}\nENDPROC\n"


def _num(name: str, body: str, parameters: str = "") -> str:
    return f"FUNC num {name}({parameters})\n{body}\nENDFUNC\n"


GO, OTHER = _to("p1"), _to("p2")
NOW_B = _to("pNow", "wobB")
SHIFTING = _proc("leave", _SHIFT)
HOME = "\nPDispOff;"
ASKING = _num("ask", f"{_SHIFT}\nRETURN 1;")
ASKING_A_POINT = _num("size", "RETURN r.trans.x;", "robtarget r")
PARAMETERS = "robtarget r,speeddata v,zonedata z,PERS tooldata t\\PERS wobjdata WObj"
COUNT = "FOR i FROM 1 TO 2 DO\n"

CELLS: dict[str, list[Cell]] = {
    "unknown-statement": [
        _cell(f"<SMT>\n{_SHIFT}\n{GO}{HOME}", p1="refuse"),
        _cell(f"{OTHER}\n<EXP>\nwobA.oframe.trans.z:=15;\n{GO}", p1="refuse", p2="refuse"),
        _cell(f"<SMT>\np1.trans.x:=500;\n{GO}\n{OTHER}", p1="skip", p2="correct"),
        _cell(f"<SMT>\nleave;\n{GO}{HOME}", SHIFTING, p1="refuse"),
        _cell(f"leave;\n{GO}{HOME}", f'PROC note()\nTPWrite "ready";\n<SMT>\nENDPROC\n{SHIFTING}', p1="refuse"),
        _cell(f"IF nUp>3 <SMT>\n{_SHIFT}\n{GO}{HOME}", p1="refuse"),
        _cell(f"IF <EXP> THEN\n<SMT>\nELSE\n<SMT>\n{GO}\nENDIF\n{OTHER}", p1="correct", p2="correct"),
        _cell(f"rElsewhere p1,<ARG>;\n{GO}\n{OTHER}", p1="refuse", p2="correct"),
        _cell(f"MToolRotCalib pMany{{1}},pMany{{2}},tGun;\n{GO}", p1="refuse"),
        _cell(GO, data="\u3000\nCONST robtarget p3:=p2;", p1="correct", p2="skip"),
    ],
    "coordinate-in-position": [
        _cell(
            f"{_to('[[p1.trans.y,p1.trans.x,50],p1.rot,p1.robconf,p1.extax]')}\n{GO}\n{OTHER}",
            p1="refuse",
            p2="correct",
        ),
        _cell(
            f"{_to('p2,[[p1.trans.y,8,5],p2.rot,p2.robconf,p2.extax]', word='MoveC')}\n{GO}", p1="refuse", p2="refuse"
        ),
        _cell(f"MoveAbsJ [[p1.trans.x,0,0,0,0,0],p1.extax],v200,fine,tGun;\n{GO}", p1="refuse"),
        _cell(
            f"{GO}\n{OTHER}",
            data="CONST robtarget p3:=[[p1.trans.y,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];",
            p1="refuse",
            p2="correct",
        ),
    ],
    "coordinate-in-number": [
        _cell(f"nUp:=p1.trans.z;\n{_to('Offs(p2,0,0,nUp)')}\n{GO}\n{OTHER}", p1="refuse", p2="skip"),
        _cell(f"nUp:=p1.trans.z;\n{GO}\nIF nUp>10 {OTHER}", p1="refuse", p2="correct"),
        _cell(f"nUp:=p1.trans.z+5;\nSetAO aoUp,nUp;\n{GO}\n{OTHER}", p1="refuse", p2="correct"),
        _cell(f"{_to('Offs(p2,0,0,nHigh)')}\n{GO}", data="CONST num nHigh:=p1.trans.z;", p1="refuse", p2="skip"),
        _cell(f"nUp:=p1.trans.z;\n{_to('Offs(p2,0,0,nUp)')}\n{GO}", derived=True, p1="refuse", p2="skip"),
        _cell(f"nUp:=height();\n{GO}", _num("height", "RETURN p1.trans.z;"), p1="refuse"),
        _cell(f"nUp:=5;\n{GO}\nIF nUp>10 {OTHER}", p1="correct", p2="correct"),
    ],
    "coordinate-in-frame": [
        _cell(f"wobB.uframe.trans:=p1.trans;\n{GO}\n{_to('p2', 'wobB')}", p1="refuse", p2="refuse"),
        _cell(f"wobB.oframe.trans.z:=p1.trans.z;\n{GO}", p1="refuse"),
        _cell(f"pseOff.trans:=p1.trans;\n{GO}\nPDispSet pseOff;\n{OTHER}{HOME}", p1="refuse", p2="refuse"),
        _cell(f"{GO}\n{OTHER}", data="CONST pose pseHigh:=[p1.trans,p1.rot];", p1="refuse", p2="correct"),
        _cell(f"PDispOn\\Rot,p1,tGun;\n{OTHER}\nPDispOff;\n{GO}", p1="refuse", p2="refuse"),
    ],
    "expression-in-modifier": [
        _cell(f"MoveL p2,v200\\V:=p1.trans.x,fine,tGun\\WObj:=wobA;\n{GO}", p1="refuse", p2="correct"),
        _cell(f"WaitUntil p1.trans.x>5\\MaxTime:=2;\n{GO}\n{OTHER}", p1="refuse", p2="correct"),
        _cell(f"MoveL p2,v200,fine,tGun\\WObj:=wobA\\TLoad:=load0;\n{GO}", p1="correct", p2="correct"),
    ],
    "called-program-shifts": [
        _cell(f"leave;\n{GO}{HOME}\n{OTHER}", SHIFTING, p1="refuse", p2="correct"),
        _cell(f"outer;\n{GO}{HOME}", SHIFTING + _proc("outer", "leave;"), p1="refuse"),
        _cell(f"CutL p2,v200,fine,tGun\\WObj:=wobA;\n{GO}{HOME}", _proc("CutL", _SHIFT, PARAMETERS), p1="refuse"),
        _cell(f'IF ok %"leave"%;\n{GO}{HOME}', SHIFTING, p1="refuse"),
        _cell(f"IF nUp=0xFF leave;\n{GO}{HOME}", SHIFTING, p1="refuse"),
        _cell(f"leave nBy:=5;\n{GO}{HOME}", _proc("leave", _SHIFT, "num nBy"), p1="refuse"),
        _cell(f"leave;\n{GO}", _proc("leave", f"{_SHIFT}{HOME}"), p1="correct"),
    ],
    "called-program-sets-frame": [
        _cell(f"{GO}\nmeasure;", _proc("measure", "wobA.uframe.trans.x:=860;"), p1="refuse"),
        _cell(f"{GO}\nmeasure;", _proc("measure", "tGun.tframe:=pseOff;"), p1="refuse"),
        _cell(f"{GO}\nmeasure;", _proc("measure", "wobB.uframe.trans.x:=860;"), p1="correct"),
    ],
    "handler-changes-state": [
        _cell(f"CONNECT irStop WITH tStop;\n{GO}{HOME}", f"TRAP tStop\n{_SHIFT}\nENDTRAP\n", p1="refuse"),
        _cell(f"CONNECT irStop WITH tStop;\n{GO}{HOME}", f"TRAP tStop\nleave;\nENDTRAP\n{SHIFTING}", p1="refuse"),
        _cell(
            f"CONNECT irStop WITH tStop;\n{GO}{HOME}", f'TRAP tStop\nIF ok %"leave"%;\nENDTRAP\n{SHIFTING}', p1="refuse"
        ),
        _cell(f"{GO}\n{NOW_B}", "TRAP tStop\npNow:=p1;\nENDTRAP\n", p1="refuse"),
        _cell(f"CONNECT irStop WITH tStop;\n{GO}", "TRAP tStop\nSetDO doStop,1;\nENDTRAP\n", p1="correct"),
    ],
    "certain-loop": [
        _cell(f"{COUNT}{_SHIFT}\nENDFOR\n{GO}{HOME}", p1="refuse"),
        _cell(f"{GO}\n{COUNT}wobA:=wobB;\nENDFOR", p1="refuse"),
        _cell(f"{COUNT}{GO}\n{_SHIFT}\nENDFOR{HOME}", p1="refuse"),
    ],
    "conditional-frame": [
        _cell(f"IF ok {_SHIFT}\n{GO}{HOME}", p1="refuse"),
        _cell(f"TEST nAt\nCASE 1:\nwobA.oframe:=pseOff;\nENDTEST\n{GO}", p1="refuse"),
        _cell(f"IF ok THEN\n{_SHIFT}\nENDIF\nPDispOff;\n{GO}", p1="correct"),
    ],
    "frame-written-by-call": [
        *(
            _cell(f"{statement}\n{GO}", p1="refuse")
            for statement in (
                "ok:=StrToVal(stText,wobA);",
                "IF StrToVal(stText,wobA.oframe) Stop;",
                "GetSysData tGun;",
                'GetDataVal "wobB",wobA;',
                "UnpackRawBytes rbData,1,wobA.uframe.trans.x\\Float4;",
                "ReadAnyBin ioFile,wobA;",
                "RMQGetMsgData rmqIn,wobA;",
                'ReadCfgData "/MOC/X","x",wobA.uframe.trans.x;',
                'TPReadNum wobA.oframe.trans.z,"height";',
                "Add wobA.uframe.trans.x,5;",
                "Incr wobA.uframe.trans.x;",
                "Clear tGun.tframe.trans.z;",
            )
        ),
        _cell(f"move wobA.oframe;\n{GO}", _proc("move", "pse.trans.x:=5;", "INOUT pose pse"), p1="refuse"),
        _cell(f"nUp:=move(wobA.uframe);\n{GO}", _num("move", "RETURN 1;", "INOUT pose pse"), p1="refuse"),
        _cell(f"move wobA;\n{GO}", _proc("move", "w.uframe.trans.x:=5;", "PERS wobjdata w"), p1="refuse"),
        _cell(f"move w:=wobA;\n{GO}", _proc("move", "w.uframe.trans.x:=5;", "PERS wobjdata w"), p1="refuse"),
        _cell(
            f"{GO}\nnUp:=wide(wobA.uframe.trans.x);\nGripLoad tGun.tload;",
            _num("wide", "RETURN x;", "num x"),
            p1="correct",
        ),
        _cell(f"pNow:=CRobT(\\Tool:=tGun\\WObj:=wobA);\n{GO}", p1="correct"),
    ],
    "routine-like-a-motion": [
        *(
            _cell(f"{word} p1,v200,fine,tGun\\WObj:=wobA;\n{OTHER}", _proc(word, body, PARAMETERS), p1=p1, p2=p2)
            for word in ("CutL", "GlueL", "MoveL1", "LaserJ")
            for body, p1, p2 in (
                ("MoveL Offs(r,0,0,nUp),v,z,t\\WObj:=wobB;", "skip", "correct"),
                (f"{_to('r', 'wobB')}", "correct", "correct"),
                ("IF r.trans.z>500 Stop;", "skip", "correct"),
            )
        ),
        _cell(f"GlueL p1,v200,fine,tGun\\WObj:=wobA;\n{GO}", _proc("GlueL", _to("r", "wobB"), PARAMETERS), p1="refuse"),
        _cell(f"PDispSet pseOff;\n{GO}", _proc("PDispSet", "ok:=TRUE;", "pose pse"), p1="correct"),
        _cell("GlueL p1,v200,fine,tGun\\WObj:=wobA;", p1="correct"),
    ],
    "error-leaves-a-routine": [
        _cell(f"near;\n{GO}\nERROR\nTRYNEXT;", _proc("near", f"{_SHIFT}\n{_WAIT}{HOME}"), p1="refuse"),
        _cell(f"near;\n{GO}\nERROR\nTRYNEXT;", _proc("near", f"CorrCon idCorr;\n{_WAIT}\nCorrClear;"), p1="refuse"),
        _cell(
            f"outer;\n{GO}\nERROR\nTRYNEXT;",
            _proc("near", f"{_SHIFT}\n{_WAIT}{HOME}") + _proc("outer", "near;"),
            p1="refuse",
        ),
        _cell(f"near;\n{GO}{HOME}\nERROR\nTRYNEXT;", _proc("near", f"{_WAIT}\nERROR\n{_SHIFT}\nRAISE;"), p1="refuse"),
        _cell(
            f"IF near()=1 THEN\n{GO}\nENDIF{HOME}\nERROR\nRETRY;",
            _num("near", f"{_SHIFT}\n{_WAIT}{HOME}\nRETURN 1;"),
            p1="refuse",
        ),
        _cell(
            f"near;\n{GO}\nERROR\nTRYNEXT;",
            _num("f", f"{_SHIFT}\n{_WAIT}{HOME}\nRETURN 1;") + _proc("near", "nUp:=f();\nERROR\nRAISE;"),
            p1="refuse",
        ),
        _cell(f"IF ok THEN\n{_SHIFT}\nRAISE 1;\nENDIF\n{GO}{HOME}\nERROR\nTRYNEXT;", p1="refuse"),
        _cell(
            f"near;\n{GO}\nERROR\nTRYNEXT;",
            _proc("near", f"{_SHIFT}\n{_WAIT}{HOME}\nERROR\nPDispOff;\nRETURN;"),
            p1="correct",
        ),
        _cell(f"{_SHIFT}\n{_WAIT}{HOME}\n{GO}\nERROR\nRETRY;", p1="correct"),
        _cell(f"near;\n{GO}\nERROR\nRETRY;", _proc("near", f"{_WAIT}\nERROR\nRAISE;"), p1="correct"),
    ],
    "array-element": [
        _cell(
            f"{_to('pMany{2}', 'wobB')}\n{COUNT}{_to('pMany{i}')}\nENDFOR",
            derived=True,
            pMany_1="correct",
            pMany_2="refuse",
        ),
        _cell(
            f"{COUNT}{_SHIFT}\n{_to('pMany{i}')}{HOME}\nENDFOR\n{_to('pMany{2}')}",
            derived=True,
            pMany_1="refuse",
            pMany_2="refuse",
        ),
        _cell(f"{_to('pFixed{nAt}')}\n{_to('pFixed{2}', 'wobB')}", pFixed_1="correct", pFixed_2="refuse"),
        _cell(f"{COUNT}{_to('pMany{i}')}\nENDFOR", derived=True, pMany_1="correct", pMany_2="correct"),
    ],
    "whole-array": [
        _cell(
            f"pCopy:=pMany;\n{_to('pCopy{1}', 'wobB')}\n{_to('pMany{1}')}",
            data="VAR robtarget pCopy{2};",
            pMany_1="skip",
        ),
        _cell(
            f"pCopy:=pMany;\n{_to('pCopy{1}', 'wobB')}\n{_to('pMany{1}')}",
            data="VAR robtarget pCopy{2};",
            derived=True,
            pMany_1="skip",
        ),
        _cell(
            f"nCopy:=nList;\n{_to('Offs(p1,0,0,nCopy{1})')}\n{GO}",
            data="VAR num nCopy{2}:=[5,6];",
            derived=True,
            p1="skip",
        ),
        _cell(
            f"recPart:=recGiven;\n{_to('recPart.at', 'wobB')}\n{GO}",
            data="CONST part recGiven:=[1,p1];\nVAR part recPart;",
            p1="refuse",
        ),
    ],
    "compact-condition": [
        _cell(f'IF ok %"leave"%;\n{GO}{HOME}', SHIFTING, p1="refuse"),
        _cell(f'IF ok %"take"%;\n{GO}\n{NOW_B}', _proc("take", "pNow:=p1;"), p1="refuse"),
        _cell(f"IF nUp=0xFF leave;\n{GO}{HOME}", SHIFTING, p1="refuse"),
        _cell(f"IF nUp=0b11 wobA:=wobB;\n{GO}", p1="refuse"),
        _cell(f"IF NOT ok AND (nUp>5 OR ok) leave;\n{GO}{HOME}", SHIFTING, p1="refuse"),
        _cell(f"IF p1.trans.z>5 Stop;\n{GO}", p1="refuse"),
        _cell(f"IF nUp=0xFF TPWrite stText;\nIF ok {GO}", p1="correct"),
    ],
    "initial-value": [
        _cell(f"{GO}\nother;", _proc("other", f"VAR robtarget pIn:=p1;\n{_to('pIn', 'wobB')}"), p1="refuse"),
        _cell(
            f"{GO}\nother;",
            _proc("other", f"CONST robtarget pIn:=p1;\n{_to('pIn', 'wobB')}"),
            derived=True,
            p1="refuse",
        ),
        _cell(
            f"{GO}\nother;", _proc("other", f"VAR robtarget pIn{{2}}:=[p1,p2];\n{_to('pIn{1}', 'wobB')}"), p1="refuse"
        ),
        _cell(
            f"{_to('pMany{1}')}\nother;",
            _proc("other", f"VAR robtarget pIn{{2}}:=pMany;\n{_to('pIn{1}', 'wobB')}"),
            pMany_1="skip",
        ),
        _cell(
            f"{GO}\nother;",
            _proc("other", f"VAR pos posIn:=p1.trans;\nPDispSet [posIn,p2.rot];\n{OTHER}{HOME}"),
            p1="refuse",
            p2="refuse",
        ),
        _cell(
            f"{GO}\nother;",
            _proc("other", f"VAR num nIn:=p1.trans.z;\n{_to('Offs(p2,0,0,nIn)')}"),
            p1="refuse",
            p2="skip",
        ),
        _cell(f"other;\n{GO}{HOME}", ASKING + _proc("other", "VAR num nIn:=ask();"), p1="refuse"),
        _cell(f"{GO}\n{OTHER}", data="CONST pos posUp:=p1.trans;", p1="refuse", p2="correct"),
        _cell("other;", _proc("other", f"VAR robtarget pIn:=p1;\n{_to('pIn')}"), p1="correct"),
    ],
    "routine-in-an-expression": [
        _cell(f"IF nUp=1 THEN\nStop;\nELSEIF ask()=1 THEN\n{GO}\nENDIF{HOME}", ASKING, p1="refuse"),
        _cell(f"IF nUp=1 THEN\nStop;\nELSEIF ask()=1 THEN\nStop;\nELSE\n{GO}\nENDIF{HOME}", ASKING, p1="refuse"),
        _cell(f"{_to('pFixed{ask()}')}\n{GO}{HOME}", ASKING, p1="refuse", pFixed_1="refuse"),
        _cell(f"pMany{{ask()}}:=p2;\n{GO}{HOME}", ASKING, p1="refuse"),
        _cell(f"nList{{size(p1)}}:=7;\n{GO}", ASKING_A_POINT, p1="refuse"),
        _cell(f"{GO}\nTEST nUp\nCASE p1.trans.x:\nStop;\nENDTEST", p1="refuse"),
        _cell(f"TEST nUp\nCASE ask():\n{GO}\nENDTEST{HOME}", ASKING, p1="refuse"),
        _cell(f"WHILE ask()=1 DO\nPDispOff;\nENDWHILE\n{GO}{HOME}", ASKING, p1="refuse"),
        _cell(
            f"MoveL p1,speed(),fine,tGun\\WObj:=wobA;{HOME}",
            f"FUNC speeddata speed()\n{_SHIFT}\nRETURN v200;\nENDFUNC\n",
            p1="refuse",
        ),
        _cell(f"take ask();\n{GO}{HOME}", ASKING + _proc("take", "ok:=TRUE;", "num n"), p1="refuse"),
        _cell(f"IF nUp=1 THEN\n{GO}\nELSEIF ask()=1 THEN\nPDispOff;\nENDIF", ASKING, p1="refuse"),
        _cell(f"IF ask()=1 {GO}", _num("ask", "RETURN 1;"), p1="correct"),
    ],
    "routine-in-a-motion": [
        *(
            _cell(f'{word} {goals},v200,z10,tGun\\WObj:=wobA,"leave";\n{GO}{HOME}', SHIFTING, p1="refuse")
            for word, goals in (("MoveLSync", "p2"), ("MoveJSync", "p2"), ("MoveCSync", "p2,pFixed{1}"))
        ),
        _cell(
            f'MoveLSync p2,v200,z10,tGun\\WObj:=wobA,"take";\n{GO}\n{NOW_B}',
            _proc("take", "pNow:=p1;"),
            p1="refuse",
            p2="correct",
        ),
        _cell(f"MoveLSync p2,v200,z10,tGun\\WObj:=wobA,stText;\n{GO}{HOME}", SHIFTING, p1="refuse"),
        _cell(
            f'MoveLSync p2,v200,z10,tGun\\WObj:=wobA,"glue";\n{GO}',
            _proc("glue", "SetDO doGlue,1;"),
            p1="correct",
            p2="correct",
        ),
    ],
    "argument-by-name": [
        _cell(f"leave nBy:=5;\n{GO}{HOME}", _proc("leave", _SHIFT, "num nBy"), p1="refuse"),
        _cell(f"go r:=p1;\n{GO}", _proc("go", _to("r", "wobB"), "robtarget r"), p1="refuse"),
        _cell(
            f"go r:=p1,w:=wobA;\n{OTHER}",
            _proc("go", "w.uframe.trans.x:=5;", "robtarget r,INOUT wobjdata w"),
            p2="refuse",
        ),
        _cell(
            f"MoveL ToPoint:=p1,Speed:=v200,Zone:=fine,Tool:=tGun\\WObj:=wobB;\n{GO}\n{OTHER}",
            p1="refuse",
            p2="correct",
        ),
    ],
    "optional-argument": [
        _cell(f"go\\r:=p1;\n{GO}", _proc("go", f"IF Present(r) {_to('r', 'wobB')}", "\\robtarget r"), p1="refuse"),
        _cell(
            "pMany{size(\\n:=1)}.trans.z:=500;\n" + _to("pMany{1}"),
            _num("size", "RETURN 1;", "\\num n"),
            pMany_1="skip",
        ),
        _cell(f"go\\w:=wobA;\n{GO}", _proc("go", "w.uframe.trans.x:=5;", "\\INOUT wobjdata w"), p1="refuse"),
        _cell(
            f"go\\fast;\n{GO}",
            _proc("go", f"IF NOT Present(fast) WaitTime 1;\n{OTHER}", "\\switch fast"),
            p1="correct",
            p2="correct",
        ),
    ],
    "argument-not-followed": [
        _cell(f"go Offs(p1,0,0,GInput(giUp));\n{GO}", _proc("go", _to("r"), "robtarget r"), p1="refuse"),
        _cell(
            f"go above(p1);\n{GO}",
            _proc("go", _to("r"), "robtarget r") + "FUNC robtarget above(robtarget r)\nRETURN r;\nENDFUNC\n",
            p1="refuse",
        ),
        _cell(f"go PoseVect(pseOff,p1.trans);\n{GO}", _proc("go", "ok:=TRUE;", "pos posAt"), p1="refuse"),
        _cell(f"go p1;\n{GO}", _proc("go", _to("r"), "robtarget r"), p1="correct"),
    ],
    "argument-written": [
        _cell(f"{_to('pNow')}\ntake pNow;\n{GO}\n{NOW_B}", _proc("take", "r:=p1;", "INOUT robtarget r"), p1="refuse"),
        _cell(f"{_to('pMany{1}')}\nok:=StrToVal(stText,pMany{{1}});", pMany_1="skip"),
        _cell(f"{_to('pMany{1}')}\nSearchL diHit,pMany{{1}},p2,v200,tGun\\WObj:=wobA;", pMany_1="skip", p2="correct"),
        _cell(f"nUp:=5;\nok:=StrToVal(stText,nUp);\n{_to('Offs(p1,0,0,nUp)')}\n{GO}", derived=True, p1="skip"),
        _cell(
            f"nUp:=5;\nraise2 nUp;\n{_to('Offs(p1,0,0,nUp)')}\n{GO}",
            _proc("raise2", "n:=n+1;", "INOUT num n"),
            derived=True,
            p1="skip",
        ),
        _cell(f"{GO}\ntake p2;", _proc("take", "r.trans.x:=5;", "robtarget r"), p1="correct"),
    ],
    "tool-through-argument": [
        _cell(f"{GO}\nuse wobA;", _proc("use", "w.oframe.trans.z:=10;", "PERS wobjdata w"), p1="refuse"),
        _cell("use wobA;", _proc("use", "MoveL p1,v200,fine,tGun\\WObj:=w;", "PERS wobjdata w"), p1="refuse"),
        _cell("use tGun;", _proc("use", "MoveL p1,v200,fine,t\\WObj:=wobA;", "PERS tooldata t"), p1="refuse"),
        _cell(f"{GO}\nuse wobA;", _proc("use", "nUp:=w.oframe.trans.z;", "wobjdata w"), p1="correct"),
    ],
    "inverse-kinematics": [
        _cell(f"MoveAbsJ CalcJointT(p1,tGun\\WObj:=wobA),v200,fine,tGun;\n{GO}\n{OTHER}", p1="refuse", p2="correct"),
        _cell(f"jNow:=CalcJointT(Offs(p1,0,0,10),tGun);\n{GO}", data="VAR jointtarget jNow;", p1="refuse"),
        _cell(
            f"MoveAbsJ CalcJointT([[p1.trans.y,8,5],p2.rot,p2.robconf,p2.extax],tGun),v200,fine,tGun;\n{GO}",
            p1="refuse",
        ),
    ],
    "chain-of-copies": [
        _cell(
            f"pUp:=p1;\nIF ok pUp:=p2;\npNow:=pUp;\n{NOW_B}\n{GO}\n{OTHER}",
            data="VAR robtarget pUp;",
            p1="refuse",
            p2="refuse",
        ),
        _cell(f"pUp:=p1;\npNow:=pUp;\nnUp:=pNow.trans.z;\n{GO}", data="VAR robtarget pUp;", p1="refuse"),
        _cell(f"pMany{{1}}:=p1;\npNow:=pMany{{nAt}};\n{NOW_B}\n{GO}", p1="refuse"),
        _cell(f"keep;\n{GO}\n{NOW_B}", _proc("keep", "pNow:=p1;"), p1="refuse"),
        _cell(f"pUp:=p1;\npNow:=pUp;\n{_to('pNow')}\n{GO}", data="VAR robtarget pUp;", p1="correct"),
    ],
    "index-read": [
        _cell(f"{_to('pFixed{p1.trans.x/100}')}\n{GO}", p1="refuse"),
        _cell(f"nList{{p1.trans.x/100}}:=7;\n{GO}", p1="refuse"),
        _cell(f"{_to('pFixed{size(p1)}')}\n{GO}", ASKING_A_POINT, p1="refuse"),
        _cell(f"{_to('Offs(pMany{p1.trans.x/100},0,0,5)')}\n{GO}", derived=True, p1="refuse"),
        _cell(f"{_to('pFixed{nAt}')}\n{GO}", p1="correct", pFixed_1="correct"),
    ],
    "arithmetic-on-a-point": [
        _cell(f"pNow:=p1;\npNow.trans.z:=pNow.trans.z+50;\n{_to('pNow')}\n{GO}", p1="refuse"),
        _cell(f"pNow:=p1;\npNow.trans.z:=2*pNow.trans.z;\n{_to('pNow')}\n{GO}", derived=True, p1="refuse"),
        _cell(f"pNow:=p1;\npNow.trans.x:=p2.trans.x;\n{_to('pNow')}\n{GO}", derived=True, p1="refuse", p2="skip"),
        _cell(f"pNow:=p1;\npNow.trans.z:=pNow.trans.z+50;\n{_to('pNow')}\n{GO}", derived=True, p1="correct"),
    ],
    "run-time-shift": [
        _cell(f"{_to('Offs(p1,0,0,GInput(giUp))')}\n{GO}", derived=True, p1="refuse"),
        _cell(f"nUp:=GInput(giUp);\n{_to('Offs(p1,0,0,nUp)')}\n{GO}", derived=True, p1="skip"),
        _cell(f"TPReadNum nUp,stText;\n{_to('RelTool(p1,0,0,nUp)')}\n{GO}", derived=True, p1="skip"),
        _cell(f"nUp:=10;\n{_to('Offs(p1,0,0,nUp)')}\n{GO}", derived=True, p1="correct"),
    ],
    "two-frames": [
        _cell(f"{GO}\n{_to('p1', 'wobB')}\n{OTHER}", p1="refuse", p2="correct"),
        _cell(f"{GO}\nMoveL p1,v200,fine,tool0\\WObj:=wobA;", p1="refuse"),
        _cell(f"{GO}\n{_to('Offs(p1,0,0,5)', 'wobB')}", derived=True, p1="refuse"),
        _cell(f"{GO}\ngo p1;", _proc("go", _to("r", "wobB"), "robtarget r"), p1="refuse"),
    ],
    "sensor-shift": [
        *(
            _cell(f"{on}\n{GO}\n{off}\n{OTHER}", p1="refuse", p2="correct")
            for on, off in (
                ("CorrCon idCorr;", "CorrClear;"),
                ("WaitWObj wobB;", "DropWObj wobB;"),
                ("ActUnit CNV1;", "DeactUnit CNV1;"),
                ("EGMActPose egmId;", "EGMReset egmId;"),
                ("SoftAct 1,50;", "SoftDeact;"),
                ("FCAct fdOn,tGun;", "FCDeact;"),
            )
        ),
        _cell(f"IF ok CorrCon idCorr;\n{GO}\nCorrClear;", p1="refuse"),
        _cell(f"MoveL\\Corr,p1,v200,fine,tGun\\WObj:=wobA;\n{OTHER}", p1="refuse", p2="correct"),
    ],
    "alias": [
        _cell(f"{GO}\npNow:=p1;\n{NOW_B}", p1="refuse"),
        _cell(f"{GO}\n{_to('pSame', 'wobB')}", data="CONST robtarget pSame:=p1;", p1="refuse"),
        _cell(
            f"{GO}\n{_to('p2', 'fxA')}",
            data='ALIAS wobjdata fixture;\nPERS fixture fxA:=[FALSE,FALSE,"CNV1",'
            "[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];",
            p1="correct",
            p2="refuse",
        ),
        _cell(
            f"{GO}\n{_to('p3')}\n{_to('p3', 'wobB')}",
            data=f"ALIAS robtarget place;\nCONST place p3:={_target(300)};",
            p1="correct",
            p3="refuse",
        ),
    ],
    "recursion": [
        _cell(f"again;{HOME}", _proc("again", f"{GO}\n{_SHIFT}\nIF ok again;"), p1="refuse"),
        _cell(
            "again p1;",
            _proc("again", f"{_to('r')}\nIF ok again Offs(r,0,0,10);", "robtarget r"),
            derived=True,
            p1="skip",
        ),
        _cell("again;", _proc("again", f"{GO}\nIF ok again;"), p1="correct"),
    ],
    "unreachable-code": [
        _cell(f"{GO}\nRETURN;\n{_to('p1', 'wobB')}", p1="refuse"),
        _cell(f"{_SHIFT}\nGOTO there;\nPDispOff;\nthere:\n{GO}{HOME}", p1="refuse"),
        _cell(f"{GO}\nGOTO there;\n{_SHIFT}\nthere:\n{OTHER}", p1="correct", p2="correct"),
    ],
    "state-across-calls": [
        _cell(f"{GO}\nleave;", SHIFTING, p1="refuse"),
        _cell(f"outer;\n{GO}{HOME}", SHIFTING + _proc("inner", "leave;") + _proc("outer", "inner;"), p1="refuse"),
        _cell(f"{_SHIFT}\ngo;{HOME}", _proc("go", GO), p1="refuse"),
        _cell(f"leave;\nback;\n{GO}", SHIFTING + _proc("back", "PDispOff;"), p1="correct"),
    ],
}
ABSENT: dict[str, str] = {
    "continue-in-loop": "RAPID has no statement that goes on with the next turn of a loop",
}

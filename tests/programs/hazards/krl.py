"""Programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell

from truepose.programs import ReadOptions

FRAMES = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
MOVES = "LIN XP1\nLIN XP2\n"
POINTS = (
    "DECL E6POS XP1={X 420.0,Y 60.0,Z 110.0,A 0.0,B 90.0,C 0.0,S 2,T 35}\n"
    "DECL E6POS XP2={X 480.0,Y 60.0,Z 110.0,A 0.0,B 90.0,C 0.0,S 2,T 35}\n"
    "DECL E6POS XA\nDECL E6POS XB\nDECL REAL H=15.0\nDECL INT N=1\nDECL BOOL OK\n"
    "DECL FRAME FUP={X 0.0,Y 0.0,Z 50.0,A 0.0,B 0.0,C 0.0}\n"
)
ARRAY = (
    "DECL E6POS XQ[3]\n"
    "XQ[1]={X 400.0,Y 0.0,Z 110.0,A 0.0,B 90.0,C 0.0}\n"
    "XQ[2]={X 410.0,Y 0.0,Z 110.0,A 0.0,B 90.0,C 0.0}\n"
    "XQ[3]={X 420.0,Y 0.0,Z 110.0,A 0.0,B 90.0,C 0.0}\n"
    "DECL INT K[2]\nK[1]=1\nK[2]=2\n"
)
POSE = "{X 400.0,Y 80.0,Z 300.0,A 0.0,B 90.0,C 0.0}"
LIT = "{X 0.0,Y 0.0,Z 300.0,A 0.0,B 0.0,C 0.0}"
BOTH = {"XP1": "correct", "XP2": "correct"}
NONE = {"XP1": "refuse", "XP2": "refuse"}
ONLY_2 = {"XP1": "refuse", "XP2": "correct"}


def cell(
    body: str,
    wanted: dict[str, str],
    routines: str = "",
    data: str = "",
    *,
    moves: str = MOVES,
    head: str = FRAMES,
    options: ReadOptions | None = None,
    fault: str = "",
) -> Cell:
    """Return a module: a head with tool and base, statements, motions to both points, other routines, more data."""
    body = f"{body}\n" if body else ""
    src = f"DEF part( )\n{head}{body}{moves}END\n{routines}"
    files = {"part.src": src, "part.dat": f"DEFDAT PART\n{POINTS}{data}ENDDAT\n"}
    return Cell(files, wanted, options or ReadOptions(), fault=fault)


def interrupt(action: str, condition: str = "$IN[1]") -> str:
    """Return the declaration of an interrupt."""
    return f"INTERRUPT DECL 3 WHEN {condition} DO {action}\nINTERRUPT ON 3"


CELLS: dict[str, list[Cell]] = {
    "unknown-statement": [
        cell("$BASE BASE_DATA[2]", NONE),
        cell("SETBASE $BASE=BASE_DATA[2]", NONE),
        cell("?? $IPO_MODE=#TCP", NONE),
        cell("?? BASE_DATA[1].Z=5.0", NONE),
        cell("SHOW XP1", ONLY_2),
        cell("?? XP1.X=500.0", ONLY_2),
        cell("WAIT SEC 0.1 XP1", ONLY_2),
        cell("?? shift", NONE, "DEF shift( )\n$BASE=BASE_DATA[2]\nEND\n"),
        cell("IF $IN[1] THEN\nHALT\nELSE $BASE=BASE_DATA[2]\nENDIF", NONE),
        cell("IF $IN[1] THEN\nHALT\nENDIF XP1", ONLY_2),
        cell("??", BOTH),
    ],
    "coordinate-in-position": [
        cell("LIN {X XP1.Z,Y XP1.Y,Z 30.0,A 0.0,B 90.0,C 0.0}", ONLY_2),
        cell("CIRC {X 1.0,Y 2.0,Z XP1.Z,A 0.0,B 90.0,C 0.0},{X 5.0,Y 2.0,Z XP1.Z,A 0.0,B 90.0,C 0.0}", ONLY_2),
        cell(f"SPLINE\nSPL {POSE[:-1]},E1 XP1.X}}\nENDSPLINE", ONLY_2),
        cell("XA={X XP1.X,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}\nLIN XA", ONLY_2),
        cell("LIN_REL {Z XP1.Z}", ONLY_2),
        cell("LIN {X H,Y 2.0,Z 30.0,A 0.0,B 90.0,C 0.0}", BOTH),
    ],
    "coordinate-in-number": [
        cell("H=XP1.Z\nLIN {X 400.0,Y 80.0,Z H,A 0.0,B 90.0,C 0.0}", ONLY_2),
        cell("H=XP1.Z\nIF H>500.0 THEN\nHALT\nENDIF", ONLY_2),
        cell("H=XP1.Z\n$ANOUT[1]=H", ONLY_2),
        cell("H=XP1.Z\nBASE_DATA[2].Z=H", ONLY_2),
        cell("H=height( )\nWAIT SEC H", ONLY_2, "DEFFCT REAL height( )\nH=XP1.Z\nRETURN H\nENDFCT\n"),
        cell("DECL REAL G\nG=XP1.X*2.0+1.0", ONLY_2, moves=f"{FRAMES}{MOVES}", head=""),
        cell("FOR N=1 TO XP1.X\nHALT\nENDFOR", ONLY_2),
        cell("height(H)\nLIN_REL {Z H}", ONLY_2, "DEF height(Q:OUT)\nDECL REAL Q\nQ=XP1.Z\nEND\n"),
        cell("SWITCH N\nCASE XP1.X\nHALT\nENDSWITCH", ONLY_2),
        cell("H=H+1.0\nIF H>500.0 THEN\nHALT\nENDIF", BOTH),
    ],
    "coordinate-in-frame": [
        cell("FUP.Z=XP1.Z\nLIN XP2:FUP", {"XP1": "refuse", "XP2": "refuse"}),
        cell("FUP={X 0.0,Y 0.0,Z XP1.Z,A 0.0,B 0.0,C 0.0}\nLIN FUP:XP2", NONE),
        cell("FUP=XP1\nXA=XP2:FUP", ONLY_2),
        cell(f"FUP.Z=XP1.Z\n$BASE=FUP\nLIN {POSE}\n{FRAMES}", ONLY_2),
        cell("BASE_DATA[2].X=XP1.X", ONLY_2),
        cell(f"$BASE=BASE_DATA[2]:XP1\nLIN {POSE}\n{FRAMES}", ONLY_2),
        cell(f"$TOOL.Z=XP1.Z\nLIN {POSE}\n{FRAMES}", ONLY_2),
        cell("FUP.Z=80.0\nLIN XA:FUP", BOTH),
    ],
    "expression-in-modifier": [
        cell("SLIN XP2 WITH $BASE={X XP1.X,Y 0.0,Z 300.0,A 0.0,B 0.0,C 0.0}", NONE),
        cell("SLIN XP2 WITH $VEL.CP=XP1.X/1000.0", ONLY_2),
        cell("CIRC XA,XB,CA XP1.X", ONLY_2),
        cell("SPLINE WITH $VEL={CP XP1.X,ORI1 100.0,ORI2 100.0}\nSPL XP2\nENDSPLINE", ONLY_2),
        cell(interrupt("note( )", "XP1.X>450.0"), ONLY_2, "DEF note( )\n$OUT[1]=TRUE\nEND\n"),
        cell("TRIGGER WHEN PATH=XP1.X DELAY=0 DO $OUT[1]=TRUE", ONLY_2),
        cell("SLIN XP2 WITH $VEL.CP=H/1000.0", BOTH),
    ],
    "called-program-shifts": [
        cell("sense( )", NONE, "DEF sense( )\nRSI_ON(#RELATIVE)\nEND\n"),
        cell("begin( )", NONE, "DEF begin( )\nsense( )\nEND\nDEF sense( )\n$TECH[1].MODE=#CYCLE\nEND\n"),
        cell("IF RSI_ON(#RELATIVE)<>1 THEN\nHALT\nENDIF", NONE),
        cell('RSI_ON(#RELATIVE)\nMSGNOTIFY("RSI_OFF()")', NONE),
        cell("sense( )", BOTH, "DEF sense( )\nRSI_ON(#RELATIVE)\nRSI_OFF( )\nEND\n"),
    ],
    "called-program-sets-frame": [
        cell("", NONE, "DEF side( )\nIF $IN[1] THEN\n$BASE=BASE_DATA[2]\nENDIF\nEND\n", moves=f"side( )\n{MOVES}"),
        cell("elsewhere( )", NONE),
        cell("TOOL_CORR_ON=TRUE\nBAS(#TOOL,1)", NONE),
        cell("side( )", BOTH, "DEF side( )\n$BASE=BASE_DATA[1]\nEND\n"),
    ],
    "handler-changes-state": [
        cell(interrupt("turn( )"), NONE, "DEF turn( )\n$IPO_MODE=#TCP\nEND\n"),
        cell(interrupt("turn( )"), NONE, "DEF turn( )\nother( )\nEND\nDEF other( )\n$TECH[1].MODE=#CYCLE\nEND\n"),
        cell(interrupt("turn( )"), NONE, "DEF turn( )\nother( )\nEND\nDEF other( )\n$BASE=BASE_DATA[2]\nEND\n"),
        cell(interrupt("turn(BASE_DATA[1])"), NONE, "DEF turn(F:OUT)\nDECL FRAME F\nF.Z=1.0\nEND\n"),
        cell(interrupt("turn(XP1)"), ONLY_2, "DEF turn(P:OUT)\nDECL E6POS P\nP.Z=1.0\nEND\n"),
        cell("TRIGGER WHEN DISTANCE=1 DELAY=0 DO turn( ) PRIO=-1", NONE, "DEF turn( )\n$IPO_MODE=#TCP\nEND\n"),
        cell("TRIGGER WHEN DISTANCE=1 DELAY=0 DO $BASE=BASE_DATA[2]\n$BASE=BASE_DATA[1]", NONE),
        cell(
            "start( )", NONE, f"DEF start( )\nGLOBAL {interrupt('turn( )')}\nEND\nDEF turn( )\n$BASE=$NULLFRAME\nEND\n"
        ),
        cell(
            interrupt("turn( )"),
            {"XP1": "refuse"},
            "DEF turn( )\nFDAT_ACT=FP9\nEND\n",
            "DECL FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}\n"
            "DECL FDAT FP9={TOOL_NO 2,BASE_NO 1,IPO_FRAME #BASE}\n",
            moves="FDAT_ACT=FP1\nBAS(#CP_PARAMS,0.5)\nLIN XP1\n",
        ),
        cell(f"RSI_ON(#RELATIVE)\n{interrupt('RSI_OFF( )')}", NONE),
        cell(interrupt("note( )"), BOTH, "DEF note( )\n$OUT[1]=TRUE\nEND\n"),
    ],
    "certain-loop": [
        # BASE_DATA[2] is certain; that it may be 1, too, is more careful than needed
        cell("FOR N=1 TO 3\n$BASE=BASE_DATA[2]\nENDFOR", NONE),
        cell("REPEAT\n$BASE=BASE_DATA[2]\nUNTIL $IN[1]", NONE),
        cell("FOR N=1 TO 3\nHALT\nENDFOR", BOTH),
    ],
    "conditional-frame": [
        cell("IF $IN[1] THEN\n$BASE=BASE_DATA[2]\nENDIF", NONE),
        cell("SWITCH N\nCASE 1\n$TOOL=TOOL_DATA[2]\nENDSWITCH", NONE),
        cell("WHILE $IN[1]\nBAS(#BASE,2)\nENDWHILE", NONE),
        cell("IF $IN[1] THEN\n$IPO_MODE=#TCP\nENDIF", NONE),
        cell("IF $IN[1] THEN\n$BASE=BASE_DATA[1]\nENDIF", BOTH),
    ],
    "frame-written-by-call": [
        cell("find(BASE_DATA[1])", NONE, "DEF find(F:OUT)\nDECL FRAME F\nF.Z=1.0\nEND\n"),
        cell('CREAD(N,N,N,N,"%r",BASE_DATA[1])', NONE),
        cell("OK=STRTOFRAME(S[],TOOL_DATA[1])", NONE, data="DECL CHAR S[80]\n"),
        cell("OK=STRTOFRAME(S[],$BASE)", NONE, data="DECL CHAR S[80]\n"),
        cell('OK=EKI_GETFRAME("cam","pose",BASE_DATA[1])', NONE),
        cell("CAST_FROM(S[],N,BASE_DATA[1])", NONE, data="DECL CHAR S[80]\n"),
        cell("find(BASE_DATA[1])", BOTH, "DEF find(F:IN)\nDECL FRAME F\nF.Z=1.0\nEND\n"),
        cell('CWRITE(N,N,N,"%r",BASE_DATA[1])', BOTH),
        cell("find(BASE_DATA[2])", BOTH, "DEF find(F:OUT)\nDECL FRAME F\nF.Z=1.0\nEND\n"),
    ],
    "routine-like-a-motion": [
        cell(
            "",
            NONE,
            "DEF LIN_TO(P:IN)\nDECL E6POS P\nIF $IN[1] THEN\n$BASE=BASE_DATA[2]\nENDIF\nLIN P\nEND\n",
            moves=f"LIN_TO(XP1)\n{MOVES}",
        ),
        cell(
            "",
            NONE,
            "DEF TIMER(T:IN)\nINT T\nIF T>1 THEN\n$BASE=BASE_DATA[2]\nENDIF\nEND\n",
            moves=f"TIMER(5)\n{MOVES}",
        ),
        cell("SLIN_UP( )", BOTH, "DEF SLIN_UP( )\nLIN_REL {Z 5.0}\nEND\n"),
    ],
    "error-leaves-a-routine": [
        # RESUME aborts `search` wherever it is
        cell(
            interrupt("found( )"),
            {"XP1": "refuse", "XP2": "correct"},
            "DEF search( )\n$BASE=BASE_DATA[2]\nLIN XP2\n$BASE=BASE_DATA[1]\nEND\nDEF found( )\nBRAKE\nRESUME\nEND\n",
            moves="search( )\nLIN XP1\n",
        ),
        cell(
            interrupt("found( )"),
            {"XP1": "refuse"},
            "DEF search( )\ninner( )\nEND\nDEF inner( )\nRSI_ON( )\nLIN XP2\nRSI_OFF( )\nEND\n"
            "DEF found( )\nleave( )\nEND\nDEF leave( )\nRESUME\nEND\n",
            moves="search( )\nLIN XP1\n",
        ),
        cell(
            f"{interrupt('found( )')}\nXA=XP1",
            {"XP1": "refuse"},
            f"DEF search( )\nXA={POSE}\nLIN XB\nXA=XP1\nEND\nDEF found( )\nRESUME\nEND\n",
            moves="search( )\nLIN XA:{X 0.0,Y 0.0,Z 5.0,A 0.0,B 0.0,C 0.0}\nLIN XP1\n",
        ),
        cell(
            interrupt("found( )"),
            {"XP1": "correct"},
            "DEF search( )\n$BASE=BASE_DATA[2]\nLIN XP2\n$BASE=BASE_DATA[1]\nEND\nDEF found( )\nBRAKE\nRESUME\nEND\n",
            moves="search( )\nBAS(#BASE,1)\nLIN XP1\n",
        ),
    ],
    "array-element": [
        cell("LIN XQ[1]\n$BASE=BASE_DATA[2]\nLIN XQ[N]", {"XQ[1]": "refuse", "XQ[2]": "correct"}, "", ARRAY),
        cell("LIN XQ[1]\n$BASE=BASE_DATA[2]\nLIN XQ[K[N]]", {"XQ[1]": "refuse", "XQ[2]": "correct"}, "", ARRAY),
        cell("LIN XQ[1]\n$BASE=BASE_DATA[2]\nFOR N=1 TO 2\nLIN (XQ[N])\nENDFOR", {"XQ[1]": "refuse"}, "", ARRAY),
        cell("XQ[N].Z=5.0\nLIN XQ[2]", {"XQ[2]": "skip"}, "", ARRAY),
        cell("XQ[K[N]]=XP1\n$BASE=BASE_DATA[2]\nLIN XQ[2]\n$BASE=BASE_DATA[1]", {"XP1": "refuse"}, "", ARRAY),
        cell(
            "LIN XQ[2]\n$BASE=BASE_DATA[2]\nFOR N=1 TO 2\nXQ[3]=XQ[1]\nLIN XQ[N]\nENDFOR",
            {"XQ[2]": "refuse"},
            "",
            ARRAY,
            options=ReadOptions(derived=True),
        ),
        cell("FOR N=1 TO 3\nLIN XQ[N]\nENDFOR", {"XQ[1]": "correct", "XQ[3]": "correct"}, "", ARRAY),
    ],
    "whole-array": [
        cell(
            "copy(XQ[])",
            {"XQ[1]": "refuse"},
            "DEF copy(P[]:OUT)\nDECL E6POS P[]\nP[1].Z=5.0\nEND\n",
            ARRAY,
            moves="LIN XQ[1]\n",
        ),
        cell("PART.P=XP1\nLIN PART.P", ONLY_2, "", "STRUC PART_T E6POS P,INT NO\nDECL PART_T PART\n"),
        cell("PART={P XP1,NO 1}", ONLY_2, "", "STRUC PART_T E6POS P,INT NO\nDECL PART_T PART\n"),
        cell("FDAT_ACT=FP9\nBAS(#FRAMES,0)", NONE, "", "DECL FDAT FP9={TOOL_NO 2,BASE_NO 1,IPO_FRAME #TCP}\n"),
    ],
    "initial-value": [
        cell("DECL E6POS P={X XP1.X,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}", ONLY_2, head="", moves=f"{FRAMES}{MOVES}"),
        cell("DECL REAL G=XP1.Z", ONLY_2, head="", moves=f"{FRAMES}{MOVES}"),
        cell("", ONLY_2, "", "DECL E6POS XC=XP1\n"),
        cell(
            "DECL INT M=count( )",
            NONE,
            "DEFFCT INT count( )\nIF $IN[2] THEN\n$BASE=$NULLFRAME\nENDIF\nRETURN 1\nENDFCT\n",
            head=f"{FRAMES}IF $IN[1] THEN\nHALT\nENDIF\n",
        ),
        cell("DECL REAL G=5.0", BOTH, head="", moves=f"{FRAMES}{MOVES}"),
    ],
    "routine-in-an-expression": [
        cell(
            "IF ask( ) THEN\nHALT\nENDIF",
            {"XP1": "correct"},
            "DEFFCT BOOL ask( )\n$BASE=BASE_DATA[1]\nRETURN TRUE\nENDFCT\n",
            moves="LIN XP1\n",
        ),
        cell(
            "WHILE ask( )\n$BASE=BASE_DATA[1]\nENDWHILE",
            {"XP2": "correct"},
            "DEFFCT BOOL ask( )\n$BASE=BASE_DATA[2]\nLIN XP1\nRETURN TRUE\nENDFCT\n",
            moves="LIN XP2\n",
        ),
        cell(
            "IF $IN[1] THEN\nHALT\nELSE\nOK=ask( )\nENDIF",
            NONE,
            "DEFFCT BOOL ask( )\n$BASE=BASE_DATA[2]\nRETURN TRUE\nENDFCT\n",
        ),
        cell(
            "REPEAT\n$BASE=BASE_DATA[1]\nUNTIL ask( )",
            {"XP1": "refuse"},
            "DEFFCT BOOL ask( )\nIF $IN[2] THEN\n$BASE=BASE_DATA[2]\nENDIF\nRETURN TRUE\nENDFCT\n",
        ),
        cell(
            "SWITCH ask( )\nCASE 1\nHALT\nENDSWITCH",
            NONE,
            "DEFFCT INT ask( )\nIF $IN[2] THEN\n$BASE=BASE_DATA[2]\nENDIF\nRETURN 1\nENDFCT\n",
        ),
        # the argument comes first: `go` moves in base 1
        cell(
            "$BASE=BASE_DATA[2]\ngo(ask( ))",
            {"XP1": "refuse"},
            "DEF go(M:IN)\nINT M\n$BASE=BASE_DATA[2]\nEND\n"
            "DEFFCT INT ask( )\n$BASE=BASE_DATA[1]\nLIN XP1\nRETURN 1\nENDFCT\n",
        ),
        cell(
            "go(ask( ))",
            {"XP1": "correct"},
            "DEF go(M:IN)\nINT M\nLIN XP1\nEND\nDEFFCT INT ask( )\n$BASE=BASE_DATA[2]\nRETURN 1\nENDFCT\n",
            moves="LIN XP2\n",
        ),
        cell(
            "XQ[ask( )]=XB",
            {"XP1": "refuse"},
            "DEFFCT INT ask( )\nIF $IN[2] THEN\n$BASE=BASE_DATA[2]\nENDIF\nRETURN 1\nENDFCT\n",
            ARRAY,
        ),
    ],
    "routine-in-a-motion": [
        cell(
            "LIN XQ[ask( )]",
            NONE,
            "DEFFCT INT ask( )\nIF $IN[2] THEN\n$BASE=BASE_DATA[2]\nENDIF\nRETURN 1\nENDFCT\n",
            ARRAY,
        ),
        cell(
            "LIN {X 1.0,Y 2.0,Z ask( ),A 0.0,B 0.0,C 0.0}",
            NONE,
            "DEFFCT REAL ask( )\n$IPO_MODE=#TCP\nRETURN 1.0\nENDFCT\n",
        ),
        cell("SLIN XA WITH $VEL.CP=ask( )", NONE, "DEFFCT REAL ask( )\nRSI_ON( )\nRETURN 1.0\nENDFCT\n"),
        cell(
            "SPLINE WITH $VEL.CP=ask( )\nSPL XA\nENDSPLINE",
            NONE,
            "DEFFCT REAL ask( )\n$IPO_MODE=#TCP\nRETURN 1.0\nENDFCT\n",
        ),
        cell(
            "TRIGGER WHEN DISTANCE=0 DELAY=0 DO side( ) PRIO=-1\nLIN XA", NONE, "DEF side( )\n$BASE=BASE_DATA[2]\nEND\n"
        ),
    ],
    "argument-not-followed": [
        cell("go(XP1)\ngo(XP1:FUP)", ONLY_2, "DEF go(P:IN)\nDECL E6POS P\nLIN P\nEND\n"),
        cell("go(XP1.X)", ONLY_2, "DEF go(R:IN)\nREAL R\nLIN_REL {X R}\nEND\n"),
        cell("go({X XP1.X,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0})", ONLY_2, "DEF go(P:IN)\nDECL POS P\nLIN P\nEND\n"),
        cell("go(H)", BOTH, "DEF go(R:IN)\nREAL R\nLIN_REL {X R}\nEND\n"),
    ],
    "argument-written": [
        cell("move_up(XP1)", ONLY_2, "DEF move_up(P:OUT)\nDECL E6POS P\nP.Z=P.Z+50.0\nEND\n"),
        cell(
            "get(XA)\n$BASE=BASE_DATA[2]\nLIN XA\n$BASE=BASE_DATA[1]",
            ONLY_2,
            "DEF get(P:OUT)\nDECL E6POS P\nP=XP1\nEND\n",
        ),
        cell(
            "get(XA)\n$BASE=BASE_DATA[2]\nLIN XA\n$BASE=BASE_DATA[1]",
            {"P": "skip"},
            f"DEF get(P:OUT)\nDECL E6POS P\n$BASE=BASE_DATA[1]\nP={POSE}\nLIN P\nEND\n",
        ),
        cell('OK=EKI_GETFRAME("cam","pose",XP1)', ONLY_2),
        cell('CREAD(N,N,N,N,"%r",XP1)', ONLY_2),
        cell(
            "set(FP1)\nFDAT_ACT=FP1\nBAS(#FRAMES,0)",
            {"XP2": "refuse"},
            "DEF set(F:OUT)\nDECL FDAT F\nF.BASE_NO=2\nEND\n",
            "DECL FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE}\n",
        ),
    ],
    "tool-through-argument": [
        cell("use(TOOL_DATA[2])", NONE, "DEF use(T:IN)\nDECL FRAME T\n$TOOL=T\nEND\n"),
        cell("use(2)", NONE, "DEF use(M:IN)\nINT M\n$BASE=BASE_DATA[M]\nEND\n"),
        cell("use(XP1)", NONE, "DEF use(T:IN)\nDECL FRAME T\n$BASE=T\nEND\n"),
        cell("use($TOOL)", NONE, "DEF use(T:OUT)\nDECL FRAME T\nT.Z=5.0\nEND\n"),
    ],
    "inverse-kinematics": [
        cell("AX=INVERSE(XP1,$AXIS_ACT,N)\nPTP AX", ONLY_2, "", "DECL E6AXIS AX\n"),
        cell("XA=FORWARD($AXIS_ACT,N)\nLIN XA", BOTH),
        cell("XA=INV_POS(XP1)", ONLY_2),
    ],
    "chain-of-copies": [
        cell("XA=XP1\nIF $IN[1] THEN\nXB=XA\nENDIF\n$BASE=BASE_DATA[2]\nLIN XB\n$BASE=BASE_DATA[1]", ONLY_2),
        cell("XA=XP1\nXB=XA\nWRITE(XB.X)", {"XP1": "refuse"}),
        cell("XA=XP1\nside( )", ONLY_2, "DEF side( )\nXB=XA\n$BASE=BASE_DATA[2]\nLIN XB\n$BASE=BASE_DATA[1]\nEND\n"),
        cell("XA=XP1\nXB=XA\nH=XB.X", ONLY_2),
        cell("XA=XP1\nXB=XA\nLIN XB", BOTH, options=ReadOptions(derived=True)),
    ],
    "index-read": [
        cell("LIN XQ[XP1.X]", ONLY_2, "", ARRAY),
        cell("LIN XQ[K[XP1.X]]", ONLY_2, "", ARRAY),
        cell("$OUT[XP1.X]=TRUE", ONLY_2),
        cell("XQ[XP1.X]=XB", ONLY_2, "", ARRAY),
        cell("FOR N=1 TO K[XP1.X]\nHALT\nENDFOR", ONLY_2, "", ARRAY),
        cell("WAIT FOR $IN[XP1.X]", ONLY_2),
        cell("$BASE=BASE_DATA[XP1.X]\n$BASE=BASE_DATA[1]", ONLY_2),
        cell("LIN XQ[N]", BOTH, "", ARRAY),
    ],
    "arithmetic-on-a-point": [
        cell("XP1.Z=XP1.Z+50.0", {"XP1": "refuse", "XP2": "correct"}),
        cell("XA=XP1\nXA.Z=XA.Z+50.0\nLIN XA", {"XP1": "refuse", "XA": "skip"}),
        cell("XA=XP1\nXA.Z=XA.Z*2.0\nLIN XA", ONLY_2, options=ReadOptions(derived=True)),
        cell("XA=XP1\nXA.X=XP2.X\nLIN XA", NONE, options=ReadOptions(derived=True)),
        cell("XA=XP1\nXA.Z=XA.Z+50.0\nLIN XA", BOTH, options=ReadOptions(derived=True)),
    ],
    "run-time-shift": [
        cell("LIN XP1:{X 0.0,Y 0.0,Z $ANIN[1],A 0.0,B 0.0,C 0.0}", ONLY_2, options=ReadOptions(derived=True)),
        cell("H=$ANIN[1]\nXA=XP1\nXA.Z=XA.Z+H\nLIN XA", ONLY_2, options=ReadOptions(derived=True)),
        cell(
            "OK=STRTOREAL(S[],H)\nLIN XP1:{X 0.0,Y 0.0,Z H,A 0.0,B 0.0,C 0.0}",
            ONLY_2,
            "",
            "DECL CHAR S[80]\n",
            options=ReadOptions(derived=True),
        ),
        cell(
            "side(H)\nLIN XP1:{X 0.0,Y 0.0,Z H,A 0.0,B 0.0,C 0.0}",
            ONLY_2,
            "DEF side(R:OUT)\nREAL R\nR=$ANIN[1]\nEND\n",
            options=ReadOptions(derived=True),
        ),
        cell(
            "TRIGGER WHEN DISTANCE=0 DELAY=0 DO H=90.0\nLIN XP1:{X 0.0,Y 0.0,Z H,A 0.0,B 0.0,C 0.0}",
            ONLY_2,
            options=ReadOptions(derived=True),
        ),
        cell("LIN XP1:{X 0.0,Y 0.0,Z H,A 0.0,B 0.0,C 0.0}", BOTH, options=ReadOptions(derived=True)),
    ],
    "two-frames": [
        cell("$BASE=BASE_DATA[2]\nLIN XP1\n$BASE=BASE_DATA[1]", ONLY_2),
        cell("SLIN XP1 WITH $TOOL=TOOL_DATA[2]", ONLY_2),
        cell("$BASE=BASE_DATA[2]\nLIN (XP1)\n$BASE=BASE_DATA[1]", ONLY_2),
        cell("SPLINE WITH $BASE=BASE_DATA[2]\nSPL XP1\nENDSPLINE", ONLY_2),
        cell("LOOP\nLIN XP1\nBAS(#BASE,2)\nIF $IN[1] THEN\nEXIT\nENDIF\nENDLOOP\nBAS(#BASE,1)", ONLY_2),
        cell("$BASE=BASE_DATA[2]\nLIN XA\n$BASE=BASE_DATA[1]", BOTH),
    ],
    "sensor-shift": [
        cell("RSI_ON(#RELATIVE)", NONE),
        cell("OK=ST_ON1(#BASE,1)", NONE),
        cell("$TECH[1].MODE=#CYCLE", NONE),
        cell("CONVEYOR.FOLLOW(1,100.0)", NONE),
        cell("$BASE=EB($NULLFRAME,N,$NULLFRAME,N)", NONE),
        cell("RSI_ON(#RELATIVE)\nRSI_OFF( )", BOTH),
    ],
    "alias": [
        Cell(
            {
                "part.src": f"DEF part( )\n{FRAMES}{MOVES}END\n",
                "part.dat": f"DEFDAT PART PUBLIC\n{POINTS}ENDDAT\n",
                "other.src": f"DEF other( )\n{FRAMES}$BASE=BASE_DATA[2]\nLIN XAGAIN\nEND\n",
                "other.dat": "DEFDAT OTHER\nIMPORT E6POS XAGAIN IS /R1/PART..XP1\nENDDAT\n",
            },
            NONE,
        ),
        cell(
            "again(XP1)",
            ONLY_2,
            "DEF again(P:OUT)\nDECL E6POS P\n$BASE=BASE_DATA[2]\nLIN P\nEND\n",
            moves=f"{FRAMES}{MOVES}",
        ),
        cell(
            "again( )",
            {"line 3": "correct"},
            "DEF again( )\nDECL E6POS XP2\nXP2=XP1\n$BASE=BASE_DATA[2]\nLIN XP2\nEND\n",
            moves=f"{FRAMES}LIN XP2\n",
        ),
    ],
    "recursion": [
        cell("again(3)", NONE, "DEF again(M:IN)\nINT M\nIF M>0 THEN\n$BASE=BASE_DATA[2]\nagain(M-1)\nENDIF\nEND\n"),
        cell(
            "again(3)",
            {"XP1": "refuse"},
            "DEF again(M:IN)\nINT M\nLIN XP1\n$BASE=BASE_DATA[2]\nagain(M-1)\nEND\n",
            moves=f"{FRAMES}LIN XP1\n",
        ),
        cell("again(3)", BOTH, "DEF again(M:IN)\nINT M\nIF M>0 THEN\nagain(M-1)\nENDIF\nEND\n"),
    ],
    "unreachable-code": [
        cell("GOTO behind\n$BASE=BASE_DATA[2]\nbehind:", BOTH),
        cell("RETURN\n$BASE=BASE_DATA[2]", {"XP1": "skip"}),
        cell(
            "GOTO behind\nagain:\n$BASE=BASE_DATA[2]\nbehind:",
            NONE,
            moves=f"{MOVES}IF $IN[1] THEN\nGOTO again\nENDIF\n",
        ),
        cell("", BOTH, "DEF never( )\n$BASE=BASE_DATA[2]\nEND\n"),
    ],
    "state-across-calls": [
        cell(
            "side( )",
            NONE,
            "DEF side( )\ninner( )\nEND\nDEF inner( )\nIF $IN[1] THEN\n$BASE=BASE_DATA[2]\nENDIF\nEND\n",
        ),
        cell(
            "FDAT_ACT=FP9\nside( )",
            NONE,
            "DEF side( )\nBAS(#FRAMES,0)\nEND\n",
            "DECL FDAT FP9={TOOL_NO 2,BASE_NO 2,IPO_FRAME #TCP}\n",
        ),
        cell("side( )\nBAS(#CP_PARAMS,0.5)", NONE, "DEF side( )\nFDAT_ACT.IPO_FRAME=#TCP\nEND\n"),
        cell("side( )", BOTH, "DEF side( )\ninner( )\nEND\nDEF inner( )\nBAS(#BASE,1)\nEND\n"),
    ],
}
ABSENT: dict[str, str] = {
    "compact-condition": "IF and its statements stand on lines of their own; a statement behind THEN or ELSE is no KRL "
    "(see unknown-statement)",
    "argument-by-name": "arguments are given by their places only",
    "optional-argument": "a parameter has no default value",
    "continue-in-loop": "CONTINUE lets the advance run go on; no statement passes the rest of a turn by",
}

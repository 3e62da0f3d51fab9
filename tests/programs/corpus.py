"""Programs in the styles that are met in the field, written for this project: each language, many hands and generators.

Each has the verdicts that its author expects. `tests/programs/test_corpus.py` reads them, `tests/programs/fuzz.py`
injures them.
"""
# ruff: noqa: E501

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from truepose.programs import FrameTable, ReadOptions

NAMES = (
    "tGrip",
    "tWeldGun",
    "tool_1",
    "Torch",
    "wFix",
    "wobj_table",
    "Workobject_1",
    "world",
    "flange",
    "tJaw",
    "fJig",
)
FRAMES = FrameTable(
    tools={**{n: np.eye(4) for n in range(17)}, **dict.fromkeys(NAMES, np.eye(4))},
    bases={**{n: np.eye(4) for n in range(33)}, **dict.fromkeys(NAMES, np.eye(4)), "G54": np.eye(4)},
)


@dataclass(frozen=True)
class Example:
    """A program: files by name (the first is given), and how many targets have which verdict."""

    files: dict[str, str]
    correct: int
    skip: int = 0
    refuse: int = 0
    encoding: str = "latin-1"
    options: ReadOptions = field(default_factory=ReadOptions)
    frames: FrameTable = FRAMES

    def data(self) -> dict[str, bytes]:
        """Return the files as they are on disk."""
        return {name: text.encode(self.encoding) for name, text in self.files.items()}


def crlf(text: str) -> str:
    """Return the text with line ends of Windows."""
    return text.replace("\n", "\r\n")


P = "{X 812.500,Y -40.250,Z 1033.000,A 90.000,B 0.000,C -180.000,S 2,T 10}"
KRL = {
    # taught on the pendant: inline forms with folds, BAS, FDAT and PDAT of the same name
    "hand-taught": Example(
        {
            "weld1.src": crlf("""&ACCESS RVP
&REL 12
&PARAM EDITMASK = *
&PARAM TEMPLATE = C:\\KRC\\Roboter\\Template\\vorgabe
DEF  weld1( )
;FOLD INI;%{PE}
  ;FOLD BASISTECH INI
    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
    INTERRUPT ON 3
    BAS (#INITMOV,0 )
  ;ENDFOLD (BASISTECH INI)
  ;FOLD USER INI
    ;Make your modifications here

  ;ENDFOLD (USER INI)
;ENDFOLD (INI)

;FOLD PTP HOME  Vel= 100 % DEFAULT;%{PE}%R 8.3.34,%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:HOME, 3:, 5:100, 7:DEFAULT
$BWDSTART = FALSE
PDAT_ACT=PDEFAULT
FDAT_ACT=FHOME
BAS (#PTP_PARAMS,100 )
$H_POS=XHOME
PTP  XHOME
;ENDFOLD

;FOLD PTP P1 Vel=100 % PDAT1 Tool[1]:Greifer Base[2]:Tisch;%{PE}%R 8.3.34,%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:P1, 3:, 5:100, 7:PDAT1
$BWDSTART=FALSE
PDAT_ACT=PPDAT1
FDAT_ACT=FP1
BAS(#PTP_PARAMS,100)
PTP XP1
;ENDFOLD

;FOLD LIN P2 CONT Vel=0.5 m/s CPDAT1 Tool[1]:Greifer Base[2]:Tisch;%{PE}%R 8.3.34,%MKUKATPBASIS,%CMOVE,%VLIN,%P 1:LIN, 2:P2, 3:C_DIS C_DIS, 5:0.5, 7:CPDAT1
$BWDSTART=FALSE
LDAT_ACT=LCPDAT1
FDAT_ACT=FP2
BAS(#CP_PARAMS,0.5)
LIN XP2 C_DIS C_DIS
;ENDFOLD

;FOLD CIRC P3 P4 Vel=0.5 m/s CPDAT2 Tool[1]:Greifer Base[2]:Tisch;%{PE}%R 8.3.34,%MKUKATPBASIS,%CMOVE,%VCIRC,%P 1:CIRC, 2:P3, 3:P4, 4:, 6:0.5, 8:CPDAT2
$BWDSTART=FALSE
LDAT_ACT=LCPDAT2
FDAT_ACT=FP4
BAS(#CP_PARAMS,0.5)
CIRC XP3, XP4
;ENDFOLD
;FOLD WAIT Time=0.5 sec;%{PE}%R 8.3.34,%MKUKATPBASIS,%CWAIT,%VWAIT,%P 2:0.5
WAIT SEC 0.5
;ENDFOLD
;FOLD OUT 12 'Schwei\xdfen' State=TRUE ;%{PE}%R 8.3.34,%MKUKATPBASIS,%COUT,%VOUTX,%P 2:12, 3:Schwei\xdfen, 5:TRUE, 6:
$OUT[12]=TRUE
;ENDFOLD
END
"""),
            "weld1.dat": crlf(f"""&ACCESS RVP
&REL 12
DEFDAT  WELD1
;FOLD EXTERNAL DECLARATIONS;%{{PE}}%MKUKATPBASIS,%CEXT,%VCOMMON,%P
;FOLD BASISTECH EXT;%{{PE}}%MKUKATPBASIS,%CEXT,%VEXT,%P
EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )
DECL INT SUCCESS
;ENDFOLD (BASISTECH EXT)
;ENDFOLD (EXTERNAL DECLARATIONS)
DECL BASIS_SUGG_T LAST_BASIS={{POINT1[] "P4                      ",POINT2[] "P3                      ",CP_PARAMS[] "CPDAT2                  ",PTP_PARAMS[] "PDAT1                   ",CONT[] "                        ",CP_VEL[] "0.5                     ",PTP_VEL[] "100                     "}}
DECL E6POS XP1={P[:-1]},E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}}
DECL FDAT FP1={{TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}
DECL PDAT PPDAT1={{VEL 100.000,ACC 100.000,APO_DIST 100.000,APO_MODE #CDIS,GEAR_JERK 50.0000}}
DECL E6POS XP2={P[:-1]},E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}}
DECL FDAT FP2={{TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}}
DECL LDAT LCPDAT1={{VEL 2.00000,ACC 100.000,APO_DIST 100.000,APO_FAC 50.0000,AXIS_VEL 100.000,AXIS_ACC 100.000,ORI_TYP #VAR,CIRC_TYP #BASE,JERK_FAC 50.0000,GEAR_JERK 50.0000,EXAX_IGN 0}}
DECL E6POS XP3={P}
DECL FDAT FP3={{TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}}
DECL E6POS XP4={P}
DECL FDAT FP4={{TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] "XP3"}}
DECL LDAT LCPDAT2={{VEL 2.0,ACC 100.0}}
ENDDAT
"""),
        },
        4,
        1,
    ),
    # KSS 8 spline inline forms
    "spline-forms": Example(
        {
            "spl.src": """DEF spl()
;FOLD SPTP HOME Vel=100 % DEFAULT ;%{PE}
SPTP XHOME WITH $VEL_AXIS[1]=SVEL_JOINT(100.0), $TOOL=STOOL2(FHOME), $BASE=SBASE(FHOME.BASE_NO), $IPO_MODE=SIPO_MODE(FHOME.IPO_FRAME), $LOAD=SLOAD(FHOME.TOOL_NO), $ACC_AXIS[1]=SACC_JOINT(PDEFAULT), $APO=SAPO_PTP(PDEFAULT), $GEAR_JERK[1]=SGEAR_JERK(PDEFAULT), $COLLMON_TOL_PRO[1]=USE_CM_PRO_VALUES(0)
;ENDFOLD
;FOLD SLIN P1 Vel=2 m/s CPDAT1 Tool[1] Base[1] ;%{PE}
SLIN XP1 WITH $VEL=SVEL_CP(2.0, , LCPDAT1), $TOOL=STOOL2(FP1), $BASE=SBASE(FP1.BASE_NO), $IPO_MODE=SIPO_MODE(FP1.IPO_FRAME), $LOAD=SLOAD(FP1.TOOL_NO), $ACC=SACC_CP(LCPDAT1), $ORI_TYPE=SORI_TYP(LCPDAT1), $APO=SAPO(LCPDAT1), $JERK=SJERK(LCPDAT1), $COLLMON_TOL_PRO[1]=USE_CM_PRO_VALUES(0)
;ENDFOLD
;FOLD SPLINE S1 Vel=2 m/s CPDAT2 Tool[1] Base[1]
SPLINE WITH $VEL=SVEL_CP(2.0, , LCPDAT1), $TOOL=STOOL2(FP1), $BASE=SBASE(FP1.BASE_NO), $IPO_MODE=SIPO_MODE(FP1.IPO_FRAME)
SPL XP1
SLIN XP2
SCIRC XP1, XP2
TIME_BLOCK START
SPL XP2
TIME_BLOCK PART = 50
SPL XP1
TIME_BLOCK END = 4.0
ENDSPLINE C_SPL
;ENDFOLD
END
""",
            "spl.dat": f"""DEFDAT SPL
DECL E6POS XP1={P}
DECL FDAT FP1={{TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE,POINT2[] " "}}
DECL LDAT LCPDAT1={{VEL 2.0,ACC 100.0,APO_DIST 100.0,APO_FAC 50.0,AXIS_VEL 100.0,AXIS_ACC 100.0,ORI_TYP #VAR,CIRC_TYP #BASE,JERK_FAC 50.0,GEAR_JERK 100.0,EXAX_IGN 0}}
DECL E6POS XP2={P}
DECL FDAT FP2={{TOOL_NO 1,BASE_NO 1,IPO_FRAME #BASE,POINT2[] " "}}
ENDDAT
""",
        },
        2,
        1,
    ),
    # generic output of an offline system: one .src, inline targets
    "offline": Example(
        {
            "Prog1.src": """&ACCESS RVP
&REL 1
&COMMENT Generated by an offline programming system
&USER EXPERT
DEF Prog1 ( )

; INTERPOLATOR INITIALIZATION
GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
INTERRUPT ON 3
BAS (#INITMOV,0 )
; SET TOOL, BASE
$BASE = {FRAME: X 0.000,Y 0.000,Z 0.000,A 0.000,B 0.000,C 0.000}
$TOOL = {FRAME: X 0.000,Y 0.000,Z 200.000,A 0.000,B 0.000,C 0.000}
$VEL.CP = 0.2
$ACC.CP = 2.5
BAS (#VEL_PTP, 30)
$APO.CDIS = 0.5
$ADVANCE = 3

PTP  {A1 0.00000,A2 -90.00000,A3 90.00000,A4 0.00000,A5 90.00000,A6 0.00000} C_PTP
LIN {X 1000.000,Y 0.000,Z 800.000,A 0.000,B 90.000,C 0.000} C_DIS
$VEL.CP = 0.05
LIN {X 1010.000,Y 0.000,Z 800.000,A 0.000,B 90.000,C 0.000} C_DIS
CIRC {X 1020.000,Y 10.000,Z 800.000,A 0.000,B 90.000,C 0.000},{X 1030.000,Y 0.000,Z 800.000,A 0.000,B 90.000,C 0.000} C_DIS
$OUT[1] = TRUE
WAIT SEC 0.2
END
"""
        },
        4,
        1,
    ),
    # another generator: E1..E6 in each target, POS variables, GO TO by E6POS literals with type
    "external-zero": Example(
        {
            "nc1.src": """DEF NC1()
BAS(#TOOL,1)
BAS(#BASE,2)
PTP {E6POS: X 1,Y 2,Z 3,A 0,B 0,C 0,S 6,T 27,E1 0,E2 0,E3 0,E4 0,E5 0,E6 0}
LIN {E6POS: X 1,Y 2,Z 3,A 0,B 0,C 0,E1 0.0,E2 0.0}
LIN {POS: X 1,Y 2,Z 3,A 0,B 0,C 0}
LIN {FRAME: X 1,Y 2,Z 3,A 0,B 0,C 0}
LIN {X 1,Y 2,Z 3,A 0,B 0,C 0,E1 500.0}
END
"""
        },
        3,
        1,
        1,
    ),
    # palletising by component arithmetic, a FRAME computed by the geometric operator
    "pallet": Example(
        {
            "pal.src": """DEF pal( )
DECL INT i, j
DECL POS pick, place
DECL FRAME offs
BAS(#TOOL,1)
BAS(#BASE,1)
pick = {X 500.0, Y 0.0, Z 300.0, A 0.0, B 90.0, C 0.0}
place = {X 500.0, Y 0.0, Z 300.0, A 0.0, B 90.0, C 0.0, S 2, T 35}
offs = $NULLFRAME
FOR i = 1 TO 3
  FOR j = 1 TO 4 STEP 1
    LIN pick
    offs.X = 100.0 * i
    offs.Y = 80.0 * j
    place.Z = 300.0 + 50.0 * j
    LIN place : offs
    LIN_REL {Z 100.0} C_DIS #BASE
  ENDFOR
ENDFOR
END
"""
        },
        1,
        3,
    ),
    # state machine with SWITCH, GOTO, subprograms with parameters, functions
    "cell-program": Example(
        {
            "cell.src": """&ACCESS RVP
DEF CELL ( )
 INIT_ALL ( )
 LOOP
  P00 (#EXT_PGNO,#PGNO_GET,DMY[],0 )
  SWITCH PGNO
  CASE 1
   P00 (#EXT_PGNO,#PGNO_ACKN,DMY[],0 )
   PART_A (TRUE, 5)
  CASE 2, 3
   PART_B ( )
  DEFAULT
   P00 (#EXT_PGNO,#PGNO_FAULT,DMY[],0 )
  ENDSWITCH
 ENDLOOP
END
DEF INIT_ALL()
 $TOOL = TOOL_DATA[2]
 $BASE = BASE_DATA[3]
END
DEF PART_A(ok:IN, n:IN)
 BOOL ok
 INT n
 INIT_ALL()
 IF ok AND (n > 3) THEN
  LIN {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}
 ELSE
  GOTO done
 ENDIF
 REPEAT
  PTP {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0,S 2,T 10}
 UNTIL $IN[5]
done:
 HALT
END
DEF PART_B()
 INIT_ALL()
 LIN {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}
 RETURN
END
DEFFCT REAL half(x:IN)
 REAL x
 RETURN(x/2)
ENDFCT
"""
        },
        3,
    ),
    # camera: targets known at run time
    "vision": Example(
        {
            "vis.src": """DEF vis()
DECL FRAME found
BAS(#TOOL,1)
BAS(#BASE,1)
EKI_GetFrame("Cam", "Sensor/Pose", found)
$BASE = BASE_DATA[1]
LIN found
LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}
$BASE = BASE_DATA[1] : found
LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}
END
""",
            "vis.dat": "DEFDAT VIS\nENDDAT\n",
        },
        1,
        1,
        1,
        options=ReadOptions(calls_keep_frames=True),
    ),
    "arrays": Example(
        {
            "arr.src": """DEF arr( )
INT i
BAS(#TOOL,1)
BAS(#BASE,1)
FOR i=1 TO 3
  LIN XP[i] C_DIS
ENDFOR
LIN XQ[2]
END
""",
            "arr.dat": f"""DEFDAT ARR
DECL E6POS XP[3]
XP[1]={P}
XP[2]={P}
XP[3]={P}
DECL POS XQ[5]
XQ[2]={P}
XQ[3]={P}
ENDDAT
""",
        },
        4,
        1,
    ),
    # old KRC1 style: lower case, no folds, tabs, spaces inside the braces, no final newline
    "old": Example(
        {
            "old.src": f"def old ( )\n\tbas (#tool, 1 )\n\tbas ( #base, 2 )\n\tptp home\n\tlin  {P.lower()}\tc_vel\n\tLIN{P}C_DIS\n\tlin {{ x 1.0 , y 2.0 , z 3.0 , a 0 , b 0 , c 0 }}\nend"
        },
        3,
        1,
    ),
    "cr-only": Example(
        {"mac.src": f"DEF mac()\rBAS(#TOOL,1)\rBAS(#BASE,1)\rLIN {P}\r;LIN {{X 1\rEND\r"},
        1,
    ),
    "utf8-bom": Example(
        {
            "u.src": f"\ufeff&ACCESS RVP\nDEF u()\nBAS(#TOOL,1)\nBAS(#BASE,1)\n;\u4e2d\u6587\u6ce8\u91ca\nLIN {P} ;\u043f\u0440\u0438\u0432\u0435\u0442\nEND\n"
        },
        1,
        encoding="utf-8",
    ),
    "continued": Example(
        {
            "c.src": "DEF c()\nBAS(#TOOL,1)\nBAS(#BASE,1)\nLIN {X 1.0,Y 2.0, \\\n  Z 3.0,A 0, \\\n B 0,C 0} C_DIS\nCIRC {X 1,Y 2,Z 3,A 0,B 0,C 0}, \\\n{X 1,Y 2,Z 3,A 0,B 0,C 0}, CA 180.0 C_ORI\nEND\n"
        },
        3,
    ),
    "triggers": Example(
        {
            "t.src": f"""DEF t()
BAS(#TOOL,1)
BAS(#BASE,1)
INTERRUPT DECL 21 WHEN $IN[1] DO stopnow()
INTERRUPT ON 21
TRIGGER WHEN DISTANCE=0 DELAY=-20 DO $OUT[4]=TRUE
LIN {P} C_DIS
TRIGGER WHEN PATH=20.0 DELAY=0 DO glue(1) PRIO=-1
SLIN {P}
ANOUT ON A1=0.5*V1+0.1 MINIMUM=0.0 MAXIMUM=1.0
CONTINUE
WAIT FOR $IN[3] AND NOT $IN[4]
SIGNAL grip $OUT[5]
PULSE($OUT[6],TRUE,0.3)
END
DEF stopnow()
BRAKE
END
DEF glue(n:IN)
INT n
$OUT[7]=TRUE
END
"""
        },
        2,
    ),
}

RT = "[[612.50,-31.20,845.00],[0.0123,-0.7071,0.7069,0.0098],[0,-1,0,1],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]"
RAPID = {
    "studio": Example(
        {
            "Module1.mod": crlf(f"""MODULE Module1
    CONST robtarget Target_10:={RT};
    CONST robtarget Target_20:={RT};
    CONST robtarget Target_30:={RT};
    !***********************************************************
    !
    ! Module:  Module1
    !
    ! Beschreibung: Schwei\xdfbahn
    !
    !***********************************************************

    PROC main()
        !Add your code here
        Path_10;
    ENDPROC
    PROC Path_10()
        MoveJ Target_10,v1000,z100,tWeldGun\\WObj:=Workobject_1;
        MoveL Target_20,v500,fine,tWeldGun\\WObj:=Workobject_1;
        MoveC Target_30,Target_10,v500,z10,tWeldGun\\WObj:=Workobject_1;
    ENDPROC
ENDMODULE
"""),
        },
        3,
    ),
    "welding": Example(
        {
            "weld.mod": f"""%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%

MODULE weld
  PERS seamdata sm1:=[0.5,0.5,[0,0,0,0,0,0,0,0,0],0,0,0,0,0,[0,0,0,0,0,0,0,0,0],0,0];
  PERS welddata wd1:=[10,0,[5,0,0,24,0,0,0,0,0],[0,0,0,0,0,0,0,0,0]];
  PERS weavedata wv1:=[1,0,3,4,0,0,0,0,0,0,0,0,0,0,0];
  TASK PERS tooldata tGun:=[TRUE,[[119.5,0,352],[0.890213544,0,0.455544074,0]],[7,[-15,0,120],[1,0,0,0],0,0,0.06]];
  TASK PERS wobjdata wJig:=[FALSE,TRUE,"",[[850,-120,300],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  LOCAL CONST robtarget pApp:={RT};
  LOCAL CONST robtarget pStart:={RT};
  LOCAL CONST robtarget pEnd:={RT};

  PROC rWeld()
    ConfL\\Off;
    SingArea\\Wrist;
    MoveJ pApp, vmax, z50, tGun\\WObj:=wJig;
    ArcLStart pStart, v200, sm1, wd1\\Weave:=wv1, fine, tGun\\WObj:=wJig;
    ArcLEnd pEnd, v10, sm1, wd1\\Weave:=wv1, fine, tGun\\WObj:=wJig\\SeamName:="S1;[";
    MoveL Offs(pEnd,0,0,100), v500, z10, tGun\\WObj:=wJig;
  ERROR
    IF ERRNO=ERR_TEST THEN
      RETRY;
    ENDIF
  ENDPROC
ENDMODULE
""",
        },
        2,
        2,
    ),
    "palletising": Example(
        {
            "pal.prg": f"""MODULE pal
  CONST robtarget pHome:={RT};
  CONST robtarget pPick:={RT};
  VAR robtarget pPlace;
  VAR num nX:=0;
  CONST num aOff{{2,3}}:=[[0,0,0],[100,0,0]];
  RECORD part
    num id;
    robtarget at;
  ENDRECORD
  FUNC robtarget Above(robtarget p,num h)
    p.trans.z:=p.trans.z+h;
    RETURN p;
  ENDFUNC
  PROC main()
    VAR robtarget local;
    FOR i FROM 1 TO 2 DO
      MoveJ pHome,v1000,z50,tGrip\\WObj:=wobj0;
      MoveL Above(pPick,50),v500,fine,tGrip;
      pPlace:=Offs(pHome,aOff{{i,1}},aOff{{i,2}},0);
      MoveL pPlace,v500,fine,tGrip;
      Set doGrip;
      WaitTime\\InPos,0.2;
      IF i=2 MoveAbsJ [[0,0,0,0,90,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1000,z50,tGrip;
    ENDFOR
    local:=CRobT(\\Tool:=tGrip\\WObj:=wobj0);
    MoveL local,v100,fine,tGrip;
  UNDO
    Reset doGrip;
  ENDPROC
  TRAP tStop
    StopMove;
    RAISE;
  ENDTRAP
ENDMODULE
""",
        },
        0,
        5,
        1,
    ),
    "inline-generated": Example(
        {
            "Prog.mod": f"""MODULE MOD_Prog
  PERS tooldata tool_1:=[TRUE,[[0,0,200],[1,0,0,0]],[2,[0,0,15],[1,0,0,0],0,0,0]];
  PROC Prog()
    ConfJ \\On;
    MoveAbsJ [[0,0,0,0,90,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[500,500,5000,1000],[FALSE, 0.300, 0.300, 0.300, 0.030, 0.300, 0.030],tool_1,\\WObj:=wobj0;
    MoveL {RT},[100,500,5000,1000],[FALSE,1,1,1,0.1,1,0.1],tool_1,\\WObj:=wobj0;
    MoveJ {RT},v100,z1,tool_1\\WObj:=wobj0;
    MoveC {RT},{RT},v100,z1,tool_1;
  ENDPROC
ENDMODULE
""",
        },
        4,
        1,
    ),
    "old-s4": Example(
        {
            "old.prg": f"%%%\r\n  VERSION:1\r\n  LANGUAGE:ENGLISH\r\n%%%\r\n\r\nMODULE OLD\r\n  CONST robtarget P1:={RT.replace(',', ', ')};\r\n  PROC main()\r\n    MOVEL P1,V100,Z10,tGrip;\r\n    MoveL *,v10,fine,tGrip;\r\n  ENDPROC\r\nENDMODULE"
        },
        1,
        1,
    ),
    "displaced": Example(
        {
            "d.mod": f"""MODULE d
CONST robtarget a:={RT};
CONST robtarget b:={RT};
PROC main()
  MoveL a,v100,fine,tGrip;
  PDispSet [[10,0,0],[1,0,0,0]];
  MoveL b,v100,fine,tGrip;
  PDispOff;
ENDPROC
ENDMODULE
"""
        },
        1,
        0,
        1,
    ),
    "utf8-chinese": Example(
        {
            "z.mod": f'\ufeffMODULE z\n!\u4e3b\u7a0b\u5e8f\nCONST robtarget p:={RT};\nPROC main()\nMoveL p,v100,fine,tGrip; ! \u62b6\nTPWrite "\u5b8c\u6210;";\nENDPROC\nENDMODULE\n'
        },
        1,
        encoding="utf-8",
    ),
    "system-module": Example(
        {
            "user.sys": "MODULE user(SYSMODULE)\n  ! no motion\n  VAR num reg1:=0;\n  PERS tooldata t:=[TRUE,[[0,0,1],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\nENDMODULE\n"
        },
        0,
    ),
    "test-and-goto": Example(
        {
            "g.mod": f"""MODULE g
  LOCAL CONST robtarget pts{{3}}:=[{RT},
    {RT},
    {RT}];
  PROC main(\\switch dry | switch wet, num n{{*}})
  again:
    TEST n{{1}}
    CASE 1: MoveL pts{{1}},v100,z10,tGrip;
    CASE 2,3:
      FOR i FROM 2 TO Dim(pts,1) STEP 1 DO MoveL pts{{i}},v100,z10,tGrip; ENDFOR
    DEFAULT: Stop\\NoRegain;
    ENDTEST
    WHILE TRUE DO WaitDI di1,1\\MaxTime:=5; GOTO again; ENDWHILE
  ENDPROC
ENDMODULE
"""
        },
        3,
    ),
}

LP = "X =   812.500  mm,\tY =   -40.250  mm,\tZ =  1033.000  mm,\n\tW =  -179.950 deg,\tP =     -.020 deg,\tR =    90.000 deg"


def ls(mn: str, positions: str, name: str = "PROG1") -> str:
    """A TP program with the usual header."""
    return crlf(f"""/PROG  {name}
/ATTR
OWNER\t\t= MNEDITOR;
COMMENT\t\t= "test 1.5";
PROG_SIZE\t= 1024;
CREATE\t\t= DATE 21-03-04  TIME 10:11:12;
MODIFIED\t= DATE 21-03-04  TIME 10:11:12;
FILE_NAME\t= ;
VERSION\t\t= 0;
LINE_COUNT\t= 9;
MEMORY_SIZE\t= 1500;
PROTECT\t\t= READ_WRITE;
TCD:  STACK_SIZE\t= 0,
      TASK_PRIORITY\t= 50,
      TIME_SLICE\t= 0,
      BUSY_LAMP_OFF\t= 0,
      ABORT_REQUEST\t= 0,
      PAUSE_REQUEST\t= 0;
DEFAULT_GROUP\t= 1,*,*,*,*;
CONTROL_CODE\t= 00000000 00000000;
/APPL
  SPOT : TRUE ;
/MN
{mn}/POS
{positions}/END
""")


def lp(n: int, uf: int = 1, ut: int = 1, comment: str = "", pose: str = LP) -> str:
    """A position of a TP program."""
    label = f'{n}:"{comment}"' if comment else str(n)
    return f"P[{label}]{{\n   GP1:\n\tUF : {uf}, UT : {ut},\t\tCONFIG : 'N U T, 0, 0, 0',\n\t{pose}\n}};\n"


FANUC = {
    "handling": Example(
        {
            "prog1.ls": ls(
                """   1:  UFRAME_NUM=1 ;
   2:  UTOOL_NUM=1 ;
   3:  PAYLOAD[2] ;
   4:J P[1] 50% CNT100    ;
   5:L P[2:pick] 500mm/sec FINE    ;
   6:  RO[1:grip]=ON ;
   7:  WAIT    .50(sec) ;
   8:L P[2:pick] 500mm/sec CNT50 Tool_Offset,PR[3]    ;
   9:L P[3] 500mm/sec CNT50 ACC80 TB   .20sec,DO[1]=ON    ;
  10:  IF R[1:n]>=3 AND DI[2]=ON,JMP LBL[5] ;
  11:  CALL PART_A(1,R[2]) ;
  12:  LBL[5:end] ;
  13:J PR[1:HOME] 20% FINE    ;
""",
                lp(1) + lp(2, comment="pick") + lp(3),
            )
        },
        2,
        1,
        1,
    ),
    "arcs": Example(
        {
            "arc.ls": ls(
                """   1:J P[1] 100% FINE    ;
   2:L P[2] 250cm/min FINE    ;
    :  Arc Start[1,1]    ;
   3:C P[3]
    :  P[4] 80cm/min CNT100    ;
   4:A P[5] 80cm/min CNT100    ;
   5:A P[6] 80cm/min CNT100    ;
   6:L P[7] WELD_SPEED FINE
    :  Arc End[1,1]    ;
""",
                "".join(lp(n) for n in range(1, 8)),
            )
        },
        7,
    ),
    "joints-and-groups": Example(
        {
            "j.ls": ls(
                "   1:J P[1] 100% FINE    ;\n   2:L P[2] max_speed FINE    ;\n",
                "P[1]{\n   GP1:\n\tUF : 0, UT : 1,\t\n\tJ1=     0.000 deg,\tJ2=   -20.000 deg,\tJ3=     0.000 deg,\n\tJ4=     0.000 deg,\tJ5=   -90.000 deg,\tJ6=     0.000 deg\n};\n"
                + lp(2).replace("};", "   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=     0.000  mm\n};"),
            )
        },
        1,
        1,
    ),
    "german": Example(
        {
            "d.ls": ls(
                "   1:  !Gr\xfc\xdfe, P[1] nicht ändern ;\n   2:  //L P[9] 100mm/sec FINE ;\n   3:L P[1] 100mm/sec FINE    ;\n   4:  --eg:L P[3] ;\n",
                lp(1),
            )
        },
        1,
    ),
    "palletising": Example(
        {
            "pal.ls": ls(
                """   1:  UFRAME_NUM=2 ;
   2:  FOR R[1]=0 TO 3 ;
   3:  PR[10]=P[1] ;
   4:  PR[10,3]=PR[10,3]+R[1]*50 ;
   5:L PR[10] 500mm/sec FINE    ;
   6:L P[2] 500mm/sec FINE Offset,PR[11]    ;
   7:L P[R[5]] 500mm/sec FINE    ;
   8:  ENDFOR ;
   9:L P[3] 500mm/sec FINE INC    ;
  10:  SKIP CONDITION DI[5]=ON ;
  11:L P[4] 500mm/sec FINE Skip,LBL[3]    ;
  12:  LBL[3] ;
""",
                "".join(lp(n, uf=2) for n in range(1, 5)),
            )
        },
        1,
        2,
        3,
    ),
}

UR = {
    "polyscope": Example(
        {
            "prog.script": """def prog():
  set_target_payload(1.500000, [0.000000, 0.000000, 0.050000], [0.01, 0.01, 0.01, 0.0, 0.0, 0.0])
  set_tcp(p[0.0,0.0,0.15,0.0,0.0,0.0])
  set_gravity([0.0, 0.0, 9.82])
  global Waypoint_1_p=p[.312500, -.240250, .433000, 2.221441, -2.221441, .000000]
  global Waypoint_1_q=[-1.57, -1.2, 1.9, -2.2, -1.57, 0.0]
  global Waypoint_2_p=p[.312500, -.340250, .433000, 2.221441, -2.221441, .000000]
  while (True):
    # begin: URP program node tree
    $ 1 "Robot Program"
    $ 2 "MoveJ"
    $ 3 "Waypoint_1" "breakAfter"
    movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.3962634015954636, v=1.0471975511965976)
    $ 5 "MoveL"
    movel(Waypoint_2_p, a=1.2, v=0.25, r=0.005)
    $ 6 "Set DO[0]=On"
    set_standard_digital_out(0, True)
    sleep(0.5)
    # end: URP program node tree
  end
end
"""
        },
        2,
        frames=FRAMES,
    ),
    "generated": Example(
        {
            "gen.script": """def Prog():
    # Global parameters:
    global speed_ms    = 0.250
    global accel_mss   = 1.200
    set_tcp(p[0.000000, 0.000000, 0.200000, 0.000000, 0.000000, 0.000000])
    movej([-1.570796, -1.570796, 1.570796, -1.570796, -1.570796, 0.000000],accel_radss,speed_rads,0,0)
    movel(p[0.400000, -0.200000, 0.300000, 3.141593, 0.000000, 0.000000],accel_mss,speed_ms,0,blend_radius_m)
    movec(p[0.45,-0.15,0.3,3.141593,0,0],p[0.5,-0.2,0.3,3.141593,0,0],accel_mss,speed_ms,0.001)
    movep(p[0.5,-0.25,0.3,3.141593,0,0],a=accel_mss,v=speed_ms,r=0.001)
end
Prog()
"""
        },
        4,
        1,
    ),
    "driver": Example(
        {
            "ext.script": """def ext():
  textmsg("connected: ", "p[1,2,3,0,0,0]")
  socket_open("192.168.1.5", 50002)
  while True:
    params = socket_read_ascii_float(6)
    if params[0] >= 6:
      target = p[params[1], params[2], params[3], params[4], params[5], params[6]]
      movel(target, a=0.5, v=0.1)
      servoj(get_inverse_kin(target), t=0.008, lookahead_time=0.1, gain=300)
    end
    sync()
  end
end
"""
        },
        0,
        2,
    ),
    "features": Example(
        {
            "feat.script": """def feat():
  set_tcp(p[0,0,0.1,0,0,0])
  global Plane_1 = p[0.5,0.1,0.0,0,0,1.57]
  movel(pose_trans(Plane_1, p[0.1,0.2,0.05,3.14,0,0]), a=1.2, v=0.25)
  w = p[0.1,0.2,0.3,0,3.14,0]
  if (digital_in(1) == True):
    movel(w)
  elif x > 3:
    movel(pose_add(w, p[0,0,0.1,0,0,0]))
  else:
    movej(p[0.1,0.2,0.3,0,3.14,0], a=1, v=1)
  end
  v = p[0.2,0.2,0.3,0,3.14,0]
  movel(v)
  popup("done", "p[", False, False, blocking=True)
end
"""
        },
        2,
        2,
        1,
    ),
}

OTHER = {
    "jbi-mixed": Example(
        {
            "TEST.jbi": crlf("""/JOB
//NAME TEST
//POS
///NPOS 4,0,0,0,0,0
///TOOL 1
///POSTYPE PULSE
///PULSE
C00000=1000,-2000,3000,0,5000,0
///POSTYPE BASE
///RECTAN
///RCONF 1,0,0,0,0,0,0,0
C00001=812.500,-40.250,1033.000,180.0000,0.0000,90.0000
C00002=812.500,-40.250,1033.000,180.0000,0.0000,90.0000
///POSTYPE ROBOT
C00003=812.500,-40.250,1033.000,180.0000,0.0000,90.0000
//INST
///DATE 2021/03/04 10:11
///ATTR SC,RW
///GROUP1 RB1
NOP
'MOVL C00001 comment 1.5
MOVJ C00000 VJ=50.00
MOVL C00001 V=100.0 PL=1
DOUT OT#(1) ON
TIMER T=0.50
MOVC C00002 V=50.0
MOVC C00003 V=50.0
JUMP *A IF IN#(1)=ON
*A
CALL JOB:SUB
END
""")
        },
        3,
        1,
    ),
    "val3": Example(
        {
            "cell.dtx": """<?xml version="1.0" encoding="utf-8"?>
<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="http://www.staubli.com/robotics/VAL3/Data/2">
  <Datas>
    <Data name="fJig" access="public" xsi:type="array" type="frame" size="1">
      <Value key="0" x="500" y="0" z="100" rx="0" ry="0" rz="0" fatherId="world[0]" />
    </Data>
    <Data name="tJaw" access="public" xsi:type="array" type="tool" size="1">
      <Value key="0" z="120" fatherId="flange[0]" ioLink="valve1" />
    </Data>
    <Data name="pPick" access="private" xsi:type="array" type="pointRx" size="2">
      <Value key="0" x="100.5" y="-20.25" z="50" rx="180" ry="0" rz="0" shoulder="lefty" elbow="epositive" wrist="wpositive" fatherId="fJig[0]" />
      <Value key="1" x="120.5" y="-20.25" z="50" rx="180" ry="0" rz="0" fatherId="fJig[0]" />
    </Data>
    <Data name="jHome" access="private" xsi:type="array" type="jointRx" size="1">
      <Value key="0" j2="-20" j3="100" j5="80" />
    </Data>
    <Data name="mFast" type="mdesc" size="1"><Value key="0" vel="100" /></Data>
  </Datas>
</Database>
"""
        },
        2,
        1,
    ),
    "csv-semicolon": Example(
        {
            "t.csv": '\ufeffname;x_mm;y_mm;z_mm;a_deg;b_deg;c_deg;note\r\np1;1.5;2.5;3.5;0;0;0;"a;b"\r\n# comment\r\np2; 1 ; 2 ; 3 ;0;0;0;\r\n'
        },
        2,
        encoding="utf-8",
    ),
    "csv-tabs-metres": Example(
        {"m.csv": "name\tx_m\ty_m\tz_m\trx_rad\try_rad\trz_rad\np\t0.5\t-0.25\t0.3\t0\t3.14\t0\n"}, 1
    ),
    "apt-cam": Example(
        {
            "op.cls": """TOOL PATH/OP1,TOOL,MILL_10
TLDATA/MILL,10.0000,0.0000,75.0000,0.0000,0.0000
MSYS/0.0000,0.0000,0.0000,1.0000000,0.0000000,0.0000000,0.0000000,1.0000000,0.0000000
$$ centerline data
PAINT/PATH
PAINT/SPEED,10
LOADTL/1
SPINDL/RPM,1000.0,CLW
RAPID
GOTO/100.0000,50.0000,25.0000,0.0000000,0.0000000,1.0000000
FEDRAT/MMPM,250.0000
GOTO/100.0000,50.0000,5.0000
GOTO/120.1234,50.5678,5.0000,0.0871557,0.0000000,0.9961947
END-OF-PATH
FINI
"""
        },
        3,
        options=ReadOptions(angles="-z"),
        frames=FrameTable(base=0),
    ),
    "gcode-cam": Example(
        {
            "part.nc": """%
O0001 (PART 1)
(T1 D=10. CR=0. - ZMIN=-5. - flat end mill)
N10 G90 G94 G17 G21
N20 G54
N30 S5000 M3
N40 G0 X10. Y20. Z50. A0. B90. C0.
N50 G1 Z5. F250
N60 G1 X15.5 Y20.25 Z5. A0. B90. C0. F1000
X20.5 Y20.25 Z5.
N70 G2 X25. Y25. I5. J0.
N80 G1 X30. Y25. Z5. ; end of cut
N90 G28 G91 Z0.
N100 M30
%
"""
        },
        3,
        4,
        options=ReadOptions(angles="kuka", calls_keep_frames=True),
    ),
}

SAMPLES = Path(__file__).parent / "samples"
"""Many constructs of a language in one file, as far as they fit."""


def sample(*names: str) -> dict[str, str]:
    """Return files of the folder of samples."""
    return {name: (SAMPLES / name).read_bytes().decode("latin-1") for name in names}


LENIENT = ReadOptions(calls_keep_frames=True, angles="kuka")
MANY = {
    "k1": Example(sample("k1.src"), 3, 10, 1, options=LENIENT),
    "k2": Example(sample("k2.src", "k2.dat"), 2, options=LENIENT),
    "k3": Example(sample("k3.src"), 9, 12, 1, options=LENIENT),
    "k4": Example(sample("k4.src"), 0, 1, options=LENIENT),
    "r1": Example(sample("r1.mod"), 0, 8, options=LENIENT),
    "r2": Example(sample("r2.prg"), 3, 4, 3, options=LENIENT),
    "f1": Example(sample("f1.ls"), 4, 3, 1, options=LENIENT),
    "f2": Example(sample("f2.ls"), 10, options=LENIENT),
    "u1": Example(sample("u1.script"), 0, 3, 2, options=LENIENT),
    "u2": Example(sample("u2.script"), 6, 4, options=LENIENT),
    "u3": Example(sample("u3.script"), 2, options=LENIENT),
    "j1": Example(sample("j1.jbi"), 2, 2, 2, options=LENIENT),
    "v1": Example(sample("v1.dtx"), 0, 3, 2, options=LENIENT),
    "n1": Example(sample("n1.nc"), 3, 2, options=LENIENT),
    "g2": Example(sample("g2.nc"), 1, 0, 10, options=LENIENT),
    "a1": Example(sample("a1.apt"), 0, 1, 5, options=LENIENT),
}

CORPUS = {
    f"{language}-{name}": example
    for language, examples in {
        "krl": KRL,
        "rapid": RAPID,
        "fanuc": FANUC,
        "ur": UR,
        "other": OTHER,
        "many": MANY,
    }.items()
    for name, example in examples.items()
}

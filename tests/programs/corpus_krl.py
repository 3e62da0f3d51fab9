"""KUKA KRL: taught on the pendant, and from generators."""
# ruff: noqa: E501

from __future__ import annotations

from tests.programs.example import Example, crlf

from truepose.programs import ReadOptions

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
    "sensors": Example(
        {
            "s.src": f"""DEF s()
BAS(#TOOL,1)
BAS(#BASE,1)
LIN {P}
RSI_ON(#RELATIVE)
LIN {P}
RSI_OFF()
BAS(#TOOL,1)
BAS(#BASE,1)
LIN {P}
go({P},part)
END
DEF go(target :IN,part :OUT)
E6POS target
DECL parttype part
part={{NR 1,NAME[] "a"}}
LIN target
END
"""
        },
        2,
        2,
        1,
    ),
}

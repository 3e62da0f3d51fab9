"""FANUC TP listings."""
# ruff: noqa: E501

from __future__ import annotations

from tests.programs.example import FRAMES, Example, crlf

from truepose.programs import FrameTable, ReadOptions
from truepose.programs.core.program import MotionGroups

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
    "without-line-numbers": Example(
        {
            "auto.ls": ls(
                """    :UFRAME_NUM=1;
    :UTOOL_NUM=1;
    :J P[1] 100% FINE;
    :L P[2] 100mm/sec FINE;
    :C P[3]
    : P[4] 80cm/min CNT100;
    :  !L P[9] 1mm/sec FINE
    :L P[5] 100mm/sec CNT50
    :  TA .10sec,DO[1]=ON;
""",
                "".join(lp(n) for n in range(1, 6)),
            )
        },
        5,
    ),
    "tracking": Example(
        {
            "weld.ls": ls(
                """   1:J P[1] 50% CNT100    ;
   2:  Search Start[1] PR[1] ;
   3:L P[2] 10mm/sec FINE Search[Z]    ;
   4:  Search End ;
   5:  Touch Offset PR[1] ;
   6:L P[3] 250mm/sec FINE    ;
    :  Arc Start[1,1]    ;
   7:  Track TAST[1] RPM[1] ;
   8:L P[4] 80cm/min CNT100    ;
   9:  Track End ;
  10:L P[5] 80cm/min FINE
    :  Arc End[1,1]    ;
  11:  Touch Offset End ;
  12:  MP Offset PR[2] RPM[1] ;
  13:L P[6] 80cm/min FINE    ;
  14:  MP Offset End ;
  15:L P[7] 80cm/min FINE    ;
""",
                "".join(lp(n) for n in range(1, 8)),
            )
        },
        2,
        1,
        4,
    ),
    "palletising-pattern": Example(
        {
            "stack.ls": ls(
                """   1:  PALLETIZING-B_1 ;
   2:J PAL_1[A_1] 30% CNT50    ;
   3:L PAL_1[BTM] 100mm/sec FINE    ;
   4:L PAL_1[R_1] 100mm/sec CNT50    ;
   5:  PALLETIZING-END_1 ;
   6:J P[1] 50% FINE    ;
""",
                lp(1),
            )
        },
        1,
        3,
    ),
    "registers": Example(
        {
            "reg.ls": ls(
                """   1:  UFRAME_NUM=1 ;
   2:  UTOOL_NUM=1 ;
   3:  PR[1]=P[1] ;
   4:  PR[1,3]=PR[1,3]+50 ;
   5:L PR[1:above] 500mm/sec CNT50    ;
   6:L P[1] 100mm/sec FINE    ;
   7:  PR[2]=LPOS-LPOS ;
   8:  PR[2,3]=80 ;
   9:L P[2] 500mm/sec CNT50 Offset,PR[2]    ;
  10:  FOR R[1]=0 TO 2 ;
  11:  PR[3]=P[2] ;
  12:  R[2]=R[1]*40.5 ;
  13:  PR[3,1]=PR[3,1]+R[2] ;
  14:L PR[3] 500mm/sec FINE    ;
  15:  ENDFOR ;
  16:  FOR R[3]=1 TO 2 ;
  17:J P[R[3]] 50% FINE    ;
  18:  ENDFOR ;
  19:  PR[4]=P[3] ;
  20:  PR[4,6]=PR[4,6]+90 ;
  21:L PR[4] 500mm/sec FINE    ;
  22:L P[3] 500mm/sec FINE    ;
""",
                "".join(lp(n) for n in range(1, 4)),
            )
        },
        2,
        5,
        1,
        options=ReadOptions(derived=True, whole_task=True),
    ),
    "groups": Example(
        {
            "ring.ls": ls(
                """   1:  UFRAME_NUM[GP1]=1 ;
   2:  UTOOL_NUM[GP1,GP2]=1 ;
   3:J P[1] 50% FINE    ;
   4:L P[2] 10mm/sec CNT100 COORD    ;
   5:C P[3]
    :  P[4] 10mm/sec FINE COORD    ;
   6:  Independent GP ;
   7:  Simultaneous GP
    :  GP1 L P[5] 100mm/sec FINE
    :  GP2 J P[5] 100% FINE    ;
   8:  IF (DI[1]) THEN ;
   9:L P[6] 100mm/sec FINE TB    .10sec,P-SPS    ;
      1:  DO[1]=ON ;
       ------ ;
""",
                "".join(
                    lp(n).replace("};", "   GP2:\n\tUF : 0, UT : 0,\t\n\tJ1=    30.000 deg\n};") for n in range(1, 6)
                )
                + lp(6).replace("UF : 1, UT : 1", "UF : F, UT : F"),
            ).replace("1,*,*,*,*", "1,1,*,*,*")
        },
        6,
        frames=FrameTable(FRAMES.tools, FRAMES.bases, groups=MotionGroups(1, frozenset([2]))),
    ),
}

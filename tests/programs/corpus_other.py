"""Yaskawa INFORM, Stäubli VAL3, tables, APT and G-code."""
# ruff: noqa: E501

from __future__ import annotations

from tests.programs.example import MEASURED, Example, crlf

from truepose.programs import FrameTable, ReadOptions

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
    "jbi-conveyor": Example(
        {
            "BELT.jbi": crlf("""/JOB
//NAME BELT
//POS
///NPOS 4,0,0,0,0,0
///TOOL 1
///POSTYPE BASE
///RECTAN
///RCONF 1,0,0,0,0,0,0,0
C00000=812.500,-40.250,1033.000,180.0000,0.0000,90.0000
C00001=812.500,-40.250,1033.000,180.0000,0.0000,90.0000
C00002=812.500,-40.250,1033.000,180.0000,0.0000,90.0000
C00003=812.500,-40.250,1033.000,180.0000,0.0000,90.0000
//INST
///DATE 2021/03/04 10:11
///ATTR SC,RW
///GROUP1 RB1
NOP
MOVJ C00000 VJ=50.00
SYSTART CV#(1) STP=0.0
MOVL C00001 V=100.0
SYEND CV#(1)
COMARCON #(1)
MOVL C00002 V=10.0
COMARCOF
MOVL C00003 V=100.0
END
""")
        },
        2,
        0,
        2,
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
        frames=MEASURED,
    ),
    "val3-public": Example(
        {
            "library.dtx": """<?xml version="1.0" encoding="utf-8"?>
<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2">
  <Datas>
    <Data name="pShared" access="public" type="pointRx" size="1">
      <Value key="0" x="600" y="-20.25" z="800" rx="180" ry="0" rz="0" fatherId="world[0]" />
    </Data>
    <Data name="pOwn" access="private" type="pointRx" size="1">
      <Value key="0" x="620" y="-20.25" z="800" rx="180" ry="0" rz="0" fatherId="world[0]" />
    </Data>
  </Datas>
</Database>
"""
        },
        1,
        0,
        1,
        frames=MEASURED,
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

"""ABB RAPID, of many hands."""
# ruff: noqa: E501

from __future__ import annotations

from dataclasses import replace

from tests.programs.example import Example, crlf

from truepose.programs import ReadOptions

RT = "[[612.50,-31.20,845.00],[0.0123,-0.7071,0.7069,0.0098],[0,-1,0,1],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]"
_MODULES = {
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
# each file is all that its task has
RAPID = {name: replace(example, options=ReadOptions(whole_task=True)) for name, example in _MODULES.items()}

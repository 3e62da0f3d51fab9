MODULE r1 (SYSMODULE, NOSTEPIN, VIEWONLY)
  !# comment [[
  LOCAL VAR num nCount{10,2};
  LOCAL PERS string st:="a;b[";
  CONST num pi2:=6.28;
  ALIAS num level;
  VAR intnum intno1:=0;
  VAR clock clk;
  VAR iodev dev;
  VAR rawbytes rb;
  TASK PERS loaddata ld1:=[5,[0,0,1],[1,0,0,0],0,0,0];
  CONST speeddata vSlow:=[50,20,200,15];
  CONST zonedata zMine:=[FALSE,1,1.5,1.5,0.15,1.5,0.15];
  CONST pos p0:=[0,0,0];
  CONST orient o0:=[1,0,0,0];
  CONST pose po:=[[1,2,3],[1,0,0,0]];
  CONST robtarget p1:=[[600,0,800],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget p2:=[[600,0,800],[0,0,1,0],[-1,0,-1,0],[9E+09,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget pDummy:=[[0,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  VAR robtarget pv;
  PROC main()
    VAR num i:=0;
    VAR bool ok;
    CONNECT intno1 WITH trap1;
    ISignalDI di1,1,intno1;
    AccSet 50,50;
    VelSet 100,2000;
    ConfL\Off;
    GripLoad ld1;
    ClkReset clk; ClkStart clk;
    TPErase; TPWrite "Zahl: "\Num:=i;
    TPReadFK i,"Weiter?",stEmpty,stEmpty,stEmpty,"Ja","Nein";
    MoveJ p1,v1000\T:=5,z50\Inpos:=inpos50,tool0\TLoad:=ld1;
    MoveL p2,vSlow,zMine,tool0\WObj:=wobj0;
    MoveL RelTool(p2,0,0,-50),v100,fine,tool0;
    pv:=CRobT();
    MoveL pv,v100,fine,tool0;
    pv:=Offs(p1,1,2,3);
    SingArea\Wrist;
    SoftAct 1,50;
    WaitUntil DInput(di1)=1 AND i<5\MaxTime:=5\TimeFlag:=ok;
    IF ok=TRUE THEN
      MoveL Offs(p1,10*i,0,0),v100,z1,tool0;
    ELSEIF i>2 THEN
      GOTO lab;
    ENDIF
    lab:
    FOR j FROM 10 TO 1 STEP -1 DO
      i:=i+j MOD 2;
    ENDFOR
    %"proc"+NumToStr(i,0)%;
    callme i\flag;
    callme 5;
    Set do1; Reset do1; PulseDO\PLength:=0.2,do1; SetGO go1,5; SetAO ao1,3.5;
    TriggIO trig1,5\DOp:=do1,1;
    TriggEquip trig2,5,0.1\DOp:=do1,1;
    TriggL p1,v100,trig1\T2:=trig2,fine,tool0;
    MoveAbsJ [[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]\NoEOffs,v1000,z50,tool0;
    Open "HOME:"\File:="log.txt",dev\Append; Write dev,"x" + ValToStr(p1); Close dev;
    IF NOT (ok) OR (i<>2) Stop;
    WHILE i<3 DO Incr i; ENDWHILE
    RETURN;
    ERROR (1, ERR_PATH)
      RETRY;
    ERROR
      TEST ERRNO
      CASE ERR_DIVZERO:
        TRYNEXT;
      DEFAULT:
        RAISE;
      ENDTEST
  ENDPROC
  PROC callme(num n \switch flag, INOUT robtarget rt, VAR num arr{*})
    IF Present(flag) THEN
      MoveL rt,v100,z1,tool0;
    ENDIF
  BACKWARD
    MoveL p1,v10,fine,tool0;
  ENDPROC
  FUNC num add(num a,num b)
    RETURN a+b;
  ENDFUNC
  LOCAL TRAP trap1
    StopMove\Quick; StorePath; MoveL p2,v10,fine,tool0; RestoPath; StartMove;
  ENDTRAP
ENDMODULE

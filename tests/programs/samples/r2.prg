%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%
MODULE r2
  CONST robtarget p1:=[[600.1,-0.5,800],[-0.0000012,0.707107,0.707107,-1.2E-07],[0,0,0,0],[9E+9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget pts{2,2}:=[[[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]],[[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]]];
  PROC p_1()
    MoveL p1,v1000\V:=50,z10\Z:=5,tGrip\WObj:=wFix\TLoad:=load0;
    MoveL\Conc,p1,v1000,z10,tGrip\WObj:=wFix;
    MoveL p1\ID:=5,v100,z1,tGrip;
    MoveJ pts{1,2},v100,fine\Inpos:=inpos50,tGrip;
    MoveL Offs(pts{2,1},0,0,10),v100,z1,tGrip;
    MoveCDO p1,pts{2,2},v100,z1,tGrip,do1,1;
    MoveLSync p1,v100,z10,tGrip,"proc";
    TriggLIOs p1,v100,\TriggData1:=t1,z1,tGrip;
    SearchL\SStop,di1\Flanks,sp,p1,v100,tGrip\WObj:=wFix;
    PaintL p1,v100,z1,tGrip;
    SpotL p1,v100,gun1,spot1,tGrip\WObj:=wFix;
    DispL\On,p1,v100,bead1,z1,tGrip;
    CapL p1,v100,cd1,z1,tGrip;
    MoveExtJ jp,v100,fine;
    MoveAbsJ jp\NoEOffs,v100,fine,tGrip;
    MoveJ [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tGrip;
    MyMoveL p1,v100,z1,tGrip;
    HomeMove;
    ActUnit STN1; DeactUnit STN1;
    EOffsOff; PDispOff;
    WaitSyncTask sync1,tl;
    SyncMoveOn sync2,tl;
    MoveL p1\ID:=10,v100,z1,tGrip;
    SyncMoveOff sync3;
    FOR i FROM 1 TO Dim(pts,1) DO MoveL pts{i,1},v100,z1,tGrip; ENDFOR
    bOK:=bOK AND TRUE; s:="a"+"b;""c""";
    n:=n+1; n:=-n*2/3; a{1}:=5; r.x:=1;
    IF b1 OR (n=3 AND NOT b2) THEN MoveL p1,v100,z1,tGrip; ELSE Stop; ENDIF
  ENDPROC
ENDMODULE

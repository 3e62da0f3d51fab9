MODULE Points
  CONST robtarget pStart:=[[0,-300,100],[0,0,1,0],[-1,0,-1,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  CONST robtarget p10:=[[0,-200,0],[0,0,1,0],[-1,0,-1,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  CONST robtarget p20:=[[0,200,0],[0,0,1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  PROC rDrill()
    MoveL p10,v50,fine,tDrill\WObj:=wPanel;
    MoveL p20,v50,fine,tDrill\WObj:=wPanel;
    MoveL Offs(p20,0,0,100),v50,fine,tDrill\WObj:=wPanel;
  ENDPROC
ENDMODULE

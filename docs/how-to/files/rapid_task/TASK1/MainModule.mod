MODULE MainModule
  PERS tooldata tDrill:=[TRUE,[[0,0,250],[1,0,0,0]],[5,[0,0,100],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata wPanel:=[FALSE,TRUE,"",[[1500,0,600],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PROC main()
    MoveJ pStart,v200,fine,tDrill\WObj:=wPanel;
    rDrill;
  ENDPROC
ENDMODULE

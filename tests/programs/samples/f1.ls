/PROG  F1	  Macro
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "";
/APPL
  HANDLING : TRUE ;
  AUTO_SINGULARITY_HEADER;
    ENABLE_SINGULARITY_AVOIDANCE   : TRUE;
/MN
   1:  !comment ; with P[2] ;
   2:  --eg:*********** ;
   3:   ;
   4:  UFRAME_NUM=1 ;
   5:  UTOOL_NUM=1 ;
   6:  OVERRIDE=50% ;
   7:  PAYLOAD[1:part] ;
   8:  R[1:n]=R[2]+1 DIV 3 ;
   9:  R[3]=(R[1]*2)-SQRT[R[5]] ;
  10:  DO[1:go]=PULSE,0.5sec ;
  11:  WAIT DI[3:ok]=ON AND R[1]>2 TIMEOUT,LBL[99] ;
  12:  IF (DI[1] AND !DI[2]),JMP LBL[10] ;
  13:  SELECT R[1]=1,CALL SUB1 ;
  14:         =2,JMP LBL[10] ;
  15:         ELSE,CALL SUB2 ;
  16:  LBL[10] ;
  17:J P[1:home] 100% CNT100 ACC100 ;
  18:L P[2] R[7:spd]mm/sec CNT R[8] ACC50 Offset,PR[5:off] ;
  19:L P[3] 100mm/sec FINE TIME BEFORE .50sec,CALL OPEN ;
  20:L P[4] 10inch/min CNT0 RTCP ;
  21:J P[5] 10.0sec FINE ;
  22:L P[6] 2000deg/sec FINE Wjnt ;
  23:L P[7] 500mm/sec CNT5 DB 10.0mm,DO[3]=ON ;
  24:  $MCR.$GENOVERRIDE=50 ;
  25:  PR[1]=LPOS ;
  26:  PR[2]=JPOS ;
  27:  PR[R[3],2]=5.5 ;
  28:  VISION RUN_FIND 'PROC' ;
  29:  VISION GET_OFFSET 'PROC' VR[1] JMP LBL[99] ;
  30:L P[8] 100mm/sec FINE VOFFSET,VR[1] ;
  31:  TOOL_OFFSET CONDITION PR[3] ;
  32:  CALL SUB(1,R[2],'txt',PR[1]) ;
  33:  RUN BGPROG ;
  34:  TIMER[1]=START ;
  35:  UALM[1] ;
  36:  MESSAGE[HELLO P[1]] ;
  37:  PAUSE ;
  38:  ABORT ;
  39:  LBL[99:err] ;
  40:  END ;
/POS
P[1:"home"]{
   GP1:
	UF : 1, UT : 1,	
	J1=     0.000 deg,	J2=     0.000 deg,	J3=     0.000 deg,
	J4=     0.000 deg,	J5=   -90.000 deg,	J6=     0.000 deg
};
P[2]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[3]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[4]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[5]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[6]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[7]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[8]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
/END

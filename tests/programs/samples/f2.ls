/PROG  F2
/ATTR
COMMENT		= "x;y";
/MN
   1:  UFRAME_NUM = 0 ;
   2:  UTOOL_NUM[GP1]=1 ;
   3:J P[1] 100% FINE ;
   4:L P[2] 100mm/sec CNT100 PTH ;
   5:S P[3] 100mm/sec CNT100 ;
   6:A P[4] 100mm/sec CNT100 ;
   7:L P[5] 100mm/sec CNT100 AP_LD50 RT_LD R[1] BREAK ;
   8:L P[6] 100.5cm/min FINE SPOT[SD=1,P=1,t=2.0,S=1,ED=1] ;
   9:L P[7] 100mm/sec FINE ;
    :  Weave Sine[1] ;
  10:  Track TAST[1] ;
  11:L P[8] 100mm/sec FINE EV50% ;
  12:L P[9] R[1]mm/sec CNT R[2] Skip,LBL[5],PR[5]=LPOS ;
  13:L P[10:a b] 100mm/sec FINE P_SPRAY[1] ;
  14:  LBL[5] ;
  15:  GO[1]=R[2] ;
  16:  R[AR[1]]=AR[2] ;
  17:  SR[1]='abc;def' ;
  18:  IF DI[1]=ON THEN ;
  19:J P[1] 10% FINE ;
  20:  ELSE ;
  21:  ENDIF ;
  22:  WAIT (DI[1] AND F[2]) ;
  23:  SPOT SET[1] ;
  24:  MONITOR MON1 ;
  25:  JMP LBL[R[1]] ;
  26:  COL DETECT ON ;
  27:  RSR[1]=ENABLE ;
  28:  UFRAME[2]=PR[3] ;
  29:  MAXSPD... ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[3]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[4]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[5]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[6]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[7]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[8]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[9]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
P[10]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'F U T, 0, 0, 0',
	X =   812.500  mm,	Y =   -40.250  mm,	Z =  1033.000  mm,
	W =  -179.950 deg,	P =     -.020 deg,	R =    90.000 deg
};
/END

"""URScript."""

from __future__ import annotations

from tests.programs.example import FRAMES, MEASURED, Example

from truepose.programs import ReadOptions

UR_POSITION = """
      <JointAngles angles="-1.5, -1.6, 1.9, -1.8, -1.5, 0.2"/>
      <TCPOffset pose="0.0, 0.0, 0.15, 0.0, 0.0, 0.0"/>
      <Kinematics status="NOT_INITIALIZED" validChecksum="false">
       <deltaTheta value="0.0, 0.0, 0.0, 0.0, 0.0, 0.0"/>
       <a value="0.0, -0.425, -0.3922, 0.0, 0.0, 0.0"/>
       <d value="0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996"/>
       <alpha value="1.570796327, 0.0, 0.0, 1.570796327, -1.570796327, 0.0"/>
      </Kinematics>
"""

UR = {
    "polyscope": Example(
        {
            "prog.script": """def prog():
  set_target_payload(1.500000, [0.000000, 0.000000, 0.050000], [0.01, 0.01, 0.01, 0.0, 0.0, 0.0])
  set_tcp(p[0.0,0.0,0.15,0.0,0.0,0.0])
  set_gravity([0.0, 0.0, 9.82])
  global Waypoint_1_p=p[.312500, -.240250, .433000, 2.221441, -2.221441, .000000]
  global Waypoint_1_q=[-1.57, -1.2, 1.9, -2.2, -1.57, 0.0]
  global Waypoint_2_p=p[.312500, -.340250, .433000, 2.221441, -2.221441, .000000]
  while (True):
    # begin: URP program node tree
    $ 1 "Robot Program"
    $ 2 "MoveJ"
    $ 3 "Waypoint_1" "breakAfter"
    movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.3962634015954636, v=1.0471975511965976)
    $ 5 "MoveL"
    movel(Waypoint_2_p, a=1.2, v=0.25, r=0.005)
    $ 6 "Set DO[0]=On"
    set_standard_digital_out(0, True)
    sleep(0.5)
    # end: URP program node tree
  end
end
"""
        },
        2,
        frames=FRAMES,
    ),
    "generated": Example(
        {
            "gen.script": """def Prog():
    # Global parameters:
    global speed_ms    = 0.250
    global accel_mss   = 1.200
    set_tcp(p[0.000000, 0.000000, 0.200000, 0.000000, 0.000000, 0.000000])
    movej([-1.570796, -1.570796, 1.570796, -1.570796, -1.570796, 0.000000],accel_radss,speed_rads,0,0)
    movel(p[0.400000, -0.200000, 0.300000, 3.141593, 0.000000, 0.000000],accel_mss,speed_ms,0,blend_radius_m)
    movec(p[0.45,-0.15,0.3,3.141593,0,0],p[0.5,-0.2,0.3,3.141593,0,0],accel_mss,speed_ms,0.001)
    movep(p[0.5,-0.25,0.3,3.141593,0,0],a=accel_mss,v=speed_ms,r=0.001)
end
Prog()
"""
        },
        4,
        1,
    ),
    "driver": Example(
        {
            "ext.script": """def ext():
  textmsg("connected: ", "p[1,2,3,0,0,0]")
  socket_open("192.168.1.5", 50002)
  while True:
    params = socket_read_ascii_float(6)
    if params[0] >= 6:
      target = p[params[1], params[2], params[3], params[4], params[5], params[6]]
      movel(target, a=0.5, v=0.1)
      servoj(get_inverse_kin(target), t=0.008, lookahead_time=0.1, gain=300)
    end
    sync()
  end
end
"""
        },
        0,
        2,
    ),
    "features": Example(
        {
            "feat.script": """def feat():
  set_tcp(p[0,0,0.1,0,0,0])
  global Plane_1 = p[0.5,0.1,0.0,0,0,1.57]
  movel(pose_trans(Plane_1, p[0.1,0.2,0.05,3.14,0,0]), a=1.2, v=0.25)
  w = p[0.1,0.2,0.3,0,3.14,0]
  if (digital_in(1) == True):
    movel(w)
  elif x > 3:
    movel(pose_add(w, p[0,0,0.1,0,0,0]))
  else:
    movej(p[0.1,0.2,0.3,0,3.14,0], a=1, v=1)
  end
  v = p[0.2,0.2,0.3,0,3.14,0]
  movel(v)
  popup("done", "p[", False, False, blocking=True)
end
"""
        },
        3,
        1,
        1,
    ),
    "shared": Example(
        {
            "load.script": """def load():
  set_tcp(p[0.0, 0.0, 0.17, 0.0, 0.0, 0.0])
  global Table=p[0.65,-0.31,0.01,0.0,0.0,0.785]
  global up=p[0,0,0.08,0,0,0]
  global pick=p[0.3,-0.2,0.4,3.14,0,0]
  slots=[p[0.1,0.1,0,3.14,0,0], p[0.2,0.1,0,3.14,0,0],
    p[0.3,0.1,0,3.14,0,0]]
  def take(target, speed):
    movej(pose_add(target, up), a=1.2, v=1.0)
    movel(target, a=1.2, v=speed)
  end
  take(pick, 0.1)
  take(speed=0.2, target=p[0.35,-0.2,0.4,3.14,0,0])
  i=0
  while i < size(slots):
    movel(pose_trans(Table, slots[i]), v=0.1)
    i=i+1
  end
  above=pick
  above[2]=above[2]+0.1
  movel(above)
  movel(pose_trans(pick, p[0,0,-0.05,0,0,0]))
end
"""
        },
        5,
        4,
        options=ReadOptions(derived=True),
    ),
    "editor": Example(
        {
            "cell.urp": f"""<URProgram name="cell" installation="default" robotSerialNumber="20195010123" crcValue="1">
 <children><MainProgram runOnlyOnce="false"><children>
  <Move motionType="MoveJ" useActiveTCP="true" positionType="CartesianPose">
   <feature class="GeomFeatureReference" referencedName="Joint_0_name"/>
   <children>
    <Waypoint type="Fixed" name="W1"><position>{UR_POSITION}</position>
     <BaseToFeature pose="0.0, 0.0, 0.0, 0.0, 0.0, 0.0"/></Waypoint>
    <Waypoint type="Relative" name="W2"><position>{UR_POSITION}</position></Waypoint>
    <Waypoint reference="../Waypoint"/>
   </children>
  </Move>
  <Script type="Line">movel(p[0.1,0.2,0.3,0,3.1,0])</Script>
 </children></MainProgram></children>
</URProgram>
"""
        },
        0,
        3,
    ),
    "functions": Example(
        {
            "cell.script": """def cell():
  global approach=p[0.3,-0.2,0.4,3.14,0,0]
  global place=p[0.3,-0.2,0.3,3.14,0,0]
  def go(approach, speed):
    movel(approach, a=1.2, v=speed)
  end
  def park():
    local place=p[0.1,-0.4,0.5,3.14,0,0]
    movej(place)
  end
  movel(approach)
  go(p[0.35,-0.2,0.4,3.14,0,0], 0.25)
  go(place, 0.1)
  park()
end
"""
        },
        3,
        1,
        frames=MEASURED,
    ),
    "shifts": Example(
        {
            "belt.script": """def belt():
  movel(p[0.3,-0.2,0.4,3.14,0,0])
  track_conveyor_linear(p[1,0,0,0,0,0], 5000, 0)
  movel(p[0.3,-0.1,0.4,3.14,0,0])
  force_mode(tool_pose(), [0,0,1,0,0,0], [0,0,5,0,0,0], 2, [1,1,0.1,1,1,1])
  stop_conveyor_tracking()
  movel(p[0.3,-0.2,0.3,3.14,0,0])
  end_force_mode()
  movel(p[0.3,-0.2,0.5,3.14,0,0])
end
"""
        },
        2,
        0,
        2,
        frames=MEASURED,
    ),
}

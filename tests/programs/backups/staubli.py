"""A backup of a Stäubli controller, made by rule: applications that load a machine, deburr parts and serve a press.

The layout is that of real backups; names, numbers and programs are invented. Frames and tools are in a library. Files
differ in byte-order marks and line ends, zeros are often not written, and structures hold points.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

Pose = tuple[float, float, float, float, float, float]
FRAMES: dict[str, tuple[str, Pose]] = {
    "fCell": ("world[0]", (0.0, 0.0, 478.0, 0.0, 0.0, 0.0)),
    "fMachine": ("fCell[0]", (620.5, -310.25, -120.0, 0.0, 0.0, 90.0)),
    "fChuck": ("fMachine[0]", (35.0, 12.5, 240.0, 90.0, 0.0, -15.0)),
    "fBelt": ("fCell[0]", (-410.0, 520.75, -200.0, 0.5, -0.25, 178.0)),
    "fPress": ("world[0]", (80.0, 905.0, 310.0, 0.0, 10.0, 45.0)),
    "fVision": ("fBelt[0]", (12.0, -4.0, 0.0, 0.0, 0.0, 3.0)),
}
TOOLS: dict[str, tuple[str, Pose]] = {
    "tFlange": ("flange[0]", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "tGripA": ("flange[0]", (45.0, 0.0, 165.5, 0.0, 30.0, 0.0)),
    "tGripB": ("flange[0]", (-45.0, 0.0, 165.5, 0.0, -30.0, 180.0)),
    "tSpindle": ("tFlange[0]", (0.0, 12.0, 220.25, 0.0, 0.0, 0.0)),
}
KEYS = ("x", "y", "z", "rx", "ry", "rz")
SHAPE = 'shoulder="lefty" elbow="epositive" wrist="wpositive"'


def attributes(pose: Sequence[float], *, zeros: bool = True) -> str:
    written = zip(KEYS, pose, strict=True)
    return " ".join(f'{key}="{value:.3f}"' for key, value in written if zeros or abs(value) >= 5e-4)


def point(pose: Sequence[float], father: str, key: int = 0) -> str:
    return f'<Value key="{key}" {attributes(pose)} {SHAPE} fatherId="{father}" />'


def array(name: str, kind: str, values: Iterable[str], size: int = 0, *, public: bool = False) -> list[str]:
    rows = list(values)
    access = "public" if public else "private"
    head = f'<Data name="{name}" access="{access}" xsi:type="array" type="{kind}" size="{size or len(rows)}"'
    return [f"    {head}>", *(f"      {row}" for row in rows), "    </Data>"] if rows else [f"    {head} />"]


def dtx(rows: Iterable[str], *, bom: bool = False, end: str = "\n") -> bytes:
    head = ['<?xml version="1.0" encoding="utf-8" ?>']
    head.append(
        '<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xmlns="http://www.staubli.com/robotics/VAL3/Data/2">'
    )
    text = end.join([*head, "  <Datas>", *rows, "  </Datas>", "</Database>"])
    return (b"\xef\xbb\xbf" if bom else b"") + text.encode()


def pjx(programs: Iterable[str], data: str, libraries: dict[str, str]) -> bytes:
    rows = ['<?xml version="1.0" encoding="utf-8" ?>']
    rows += ['<Project xmlns="http://www.staubli.com/robotics/VAL3/Project/3">']
    rows += ['  <Parameters version="s7.7.2" stackSize="5000" millimeterUnit="true" />', "  <Programs>"]
    rows += [f'    <Program file="{name}.pgx" />' for name in programs]
    rows += ["  </Programs>", "  <Database>", f'    <Data file="{data}.dtx" />', "  </Database>", "  <Libraries>"]
    rows += [f'    <Library alias="{alias}" path="{path}" />' for alias, path in libraries.items()]
    return "\r\n".join([*rows, "  </Libraries>", "</Project>", ""]).encode()


def pgx(name: str, code: Iterable[str], local: Sequence[str] = (), parameters: Sequence[str] = ()) -> bytes:
    rows = ['<?xml version="1.0" encoding="utf-8" ?>']
    rows += ['<Programs xmlns="http://www.staubli.com/robotics/VAL3/Program/2">', f'  <Program name="{name}">']
    rows += ["    <Parameters>", *(f'      <Parameter name="{p}" type="pointRx" />' for p in parameters)]
    rows += ["    </Parameters>", "    <Locals>"]
    rows += [f'      <Local name="{n}" type="{"num" if n.startswith("n") else "pointRx"}" size="1" />' for n in local]
    rows += ["    </Locals>", "    <Code><![CDATA[", "begin", *(f"  {line}" for line in code), "end", "]]></Code>"]
    return "\n".join([*rows, "  </Program>", "</Programs>"]).encode()


def _pose(rng: np.random.Generator, spread: float = 120.0) -> Pose:
    x, y, z = (np.array([40.0, 30.0, 60.0]) + rng.uniform(-spread, spread, 3)).round(3).tolist()
    return x, y, z, 180.0 - round(float(rng.uniform(1, 9)), 3), 4.25, round(float(rng.uniform(-170, 170)), 3)


def library() -> dict[str, bytes]:
    """Return the application that holds frames and tools."""
    rows = array("fRoot", "frame", [f'<Value key="0" {attributes((0,) * 6)} fatherId="world[0]" />'], public=True)
    for name, (father, pose) in FRAMES.items():
        value = f'<Value key="0" {attributes(pose, zeros=False)} fatherId="{father}" />'
        rows += array(name, "frame", [value], public=True)
    for name, (father, pose) in TOOLS.items():
        value = f'<Value key="0" {attributes(pose, zeros=False)} fatherId="{father}" ioLink="valve1" />'
        rows += array(name, "tool", [value], public=True)
    code = ["fVision.trsf.x=sioGet(sCamera)", "fVision.trsf.rz=nAngle"]
    return {
        "geo/geo.pjx": pjx(["start", "see"], "geo", {}),
        "geo/geo.dtx": dtx(rows, bom=True, end="\r\n"),
        "geo/start.pgx": pgx("start", ["return"]),
        "geo/see.pgx": pgx("see", code),
    }


def loading(k: int, rng: np.random.Generator) -> dict[str, bytes]:
    """Load a machine: parts from the belt into the chuck, with approach points made of the taught ones."""
    app = f"load{k}"
    files: dict[str, bytes] = {}
    names, rows = ["start", "stop"], []
    rows += array("jHome", "jointRx", ['<Value key="0" j2="-20.000" j3="95.500" j5="75.000" />'])
    park = '<Value key="0" j1="12.500" j2="-31.250" j3="101.000" j4="0.000" j5="60.000" j6="-4.750" />'
    rows += array("jPark", "jointRx", [park])
    rows += array("mFast", "mdesc", ['<Value key="0" vel="100" />']) + array("nCount", "num", [])
    code = ["movej(jHome,geo:tGripA,mFast)"]
    for i, frame in enumerate(("fBelt", "fChuck", "fMachine", "fBelt", "fPress", "fChuck")):
        tool = "geo:tGripA" if i % 2 else "geo:tGripB"
        rows += array(f"pPart{i}", "pointRx", [point(_pose(rng), f"geo:{frame}[0]")], public=i == 5)
        rows += array(f"pVia{i}", "pointRx", [point(_pose(rng), f"geo:{frame}[0]", key) for key in range(3)])
        sub = [f"movej(pVia{i}[0],{tool},mFast)", f"movej(appro(pPart{i},{{0,0,-80,0,0,0}}),{tool},mFast)"]
        sub += [f"movel(pPart{i},{tool},mSlow)", "waitEndMove()", "open(geo:tGripA)"]
        if i % 3 == 0:
            sub += [f"pUp=appro(pPart{i},{{0,0,-120,0,0,0}})", f"movel(pUp,{tool},mSlow)"]
        elif i % 3 == 1:
            sub += [f"pUp=pPart{i}", "pUp.trsf.z=pUp.trsf.z+95.5", f"movel(pUp,{tool},mSlow)"]
        else:
            sub += [f"movec(pVia{i}[1],pVia{i}[2],{tool},mSlow)"]
        name = f"part{i}"
        names.append(name)
        files[f"{app}/{name}.pgx"] = pgx(name, sub, ["pUp"])
        code += [f"call {name}()", "if nCount>3", "  movej(jPark,geo:tGripA,mFast)", "endIf"]
    rows += array("pTray", "pointRx", [point(_pose(rng), "geo:fBelt[0]", key) for key in range(24)])
    tray = ["for nI=0 to 23", "  movel(appro(pTray[nI],{0,0,-40,0,0,0}),geo:tGripB,mSlow)"]
    files[f"{app}/tray.pgx"] = pgx("tray", [*tray, "  movel(pTray[nI],geo:tGripB,mSlow)", "endFor"], ["nI"])
    rows += array("pSeen", "pointRx", [point(_pose(rng), "geo:fVision[0]")])
    files[f"{app}/seen.pgx"] = pgx("seen", ["call geo:see()", "movel(pSeen,geo:tGripA,mSlow)"])
    rows += array("pOdd", "pointRx", [f'<Value key="1" y="12.000" rz="90.000" {SHAPE} fatherId="geo:fBelt[0]" />'], 2)
    files[f"{app}/odd.pgx"] = pgx("odd", ["movel(pOdd[1],geo:tGripA,mSlow)"])
    station = ['<Value key="0">', '  <Field name="pWait" xsi:type="array" type="pointRx" size="1">']
    station += [f"    {point(_pose(rng), 'geo:fPress[0]')}", "  </Field>"]
    station += ['  <Field name="nTime" xsi:type="array" type="num" size="1"><Value key="0" value="2" /></Field>']
    rows += array("stPress", "Station", [*station, "</Value>"], 1)
    files[f"{app}/press.pgx"] = pgx("press", ["movel(stPress.pWait,geo:tGripA,mSlow)"])
    names += ["tray", "seen", "odd", "press"]
    files[f"{app}/start.pgx"] = pgx("start", code)
    files[f"{app}/stop.pgx"] = pgx("stop", ["resetMotion()"])
    files[f"{app}/{app}.pjx"] = pjx(names, app, {"geo": "Disk://geo/geo.pjx"})
    files[f"{app}/{app}.dtx"] = dtx(rows, bom=k == 2, end="\r\n" if k == 1 else "\n")
    return files


def deburring(rng: np.random.Generator) -> dict[str, bytes]:
    """Deburr along paths of a CAM system, in the chuck's frame; one path moves to the machine's public point, too."""
    rows, files, names = array("mCut", "mdesc", ['<Value key="0" vel="25" />']), {}, ["start", "stop"]
    for k in range(4):
        t = np.linspace(0.0, 2.5, 60 + 40 * k)
        path = [(90 * np.cos(a) + k, 70 * np.sin(a), 5 + 3 * np.cos(2 * a), 175.0, 2.0 * a, 10 * a) for a in t]
        rows += array(f"pPath{k}", "pointRx", [point(p, "geo:fChuck[0]", i) for i, p in enumerate(path)])
        code = [f"for nI=0 to {len(t) - 1}", f"  movel(pPath{k}[nI],geo:tSpindle,mCut)", "endFor"]
        files[f"deburr/path{k}.pgx"] = pgx(f"path{k}", code, ["nI"])
        names.append(f"path{k}")
    rows += array("pIn", "pointRx", [point(_pose(rng), "geo:fChuck[0]")])
    rows += array("pSide", "pointRx", [point(_pose(rng), "geo:fMachine[0]")])
    enter = ["movel(compose(pSide,geo:fMachine,{0,0,nHeight,0,0,0}),geo:tSpindle,mCut)"]
    enter += ["movej(pIn,geo:tSpindle,mCut)", "movel(shared:pPart5,geo:tSpindle,mCut)"]
    files["deburr/enter.pgx"] = pgx("enter", enter)
    files["deburr/start.pgx"] = pgx("start", ["call enter()", *(f"call path{k}()" for k in range(4))])
    files["deburr/stop.pgx"] = pgx("stop", ["resetMotion()"])
    files["deburr/deburr.pjx"] = pjx([*names, "enter"], "deburr", {"geo": "geo", "shared": "../load2/load2.pjx"})
    files["deburr/deburr.dtx"] = dtx(rows)
    return files


def backup() -> dict[str, bytes]:
    """Return the files by path."""
    rng = np.random.default_rng(90)
    apps = {**library(), **loading(1, rng), **loading(2, rng), **deburring(rng)}
    files = {f"usr/usrapp/{name}": data for name, data in apps.items()}
    files["usr/configs/arm.cfx"] = b'<?xml version="1.0"?>\r\n<Arm name="TX2-90L" mount="floor" />\r\n'
    files["log/errors.log"] = b"2023-05-17 06:42 ok\r\n"
    return dict(sorted(files.items()))

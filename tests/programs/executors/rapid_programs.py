"""Random RAPID programs of what makes corrections wrong: see `tests.programs.executors`."""

from __future__ import annotations

from random import Random

from tests.programs.executors.rapid_check import Block, Line

_FRAMES = """PERS tooldata t1:=[TRUE,[[0,0,120],[1,0,0,0]],[2,[0,0,60],[1,0,0,0],0,0,0]];
PERS tooldata t2:=[TRUE,[[30,0,90],[0.7071068,0,0.7071068,0]],[2,[0,0,60],[1,0,0,0],0,0,0]];
PERS wobjdata w1:=[FALSE,TRUE,"",[[850,-200,300],[0.8660254,0,0,0.5]],[[0,0,0],[1,0,0,0]]];
PERS wobjdata w2:=[FALSE,TRUE,"",[[950,-200,300],[0,0,0,1]],[[10,0,0],[1,0,0,0]]];""".splitlines()
_DATA = """CONST num c1:=30;
CONST num ck{2}:=[10,20];
VAR num h:=5;
VAR num n:=1;
VAR num k{2}:=[1,2];
VAR num kk{2}:=[2,1];
VAR bool b;
VAR pos u;
VAR pose d:=[[0,0,30],[1,0,0,0]];
VAR string s:="x";""".splitlines()
_TAUGHT = ("p1", "p2", "p3", "p4", "p5", "p6")
PD = "PDispSet [[0,0,30],[1,0,0,0]];"


class Generator:
    """Writes a task of one or two modules."""

    def __init__(self, dice: Random) -> None:
        self.dice = dice
        self.serial = 0
        self.calls: list[str] = []
        self.depth = 0
        self.locals: list[str] = []
        self.inner_nums: list[str] = []
        self.counters: list[str] = []
        self.in_function = False
        self.handled = False
        themes = ("displacements", "objects", "two objects", "measured", "components", "errors", "offsets", "reads")
        self.themes = {theme for theme in themes if self.chance(0.4)}

    def chance(self, p: float) -> bool:
        return self.dice.random() < p

    def task(self) -> dict[str, list[Line]]:
        """Return the modules of a task, by file name."""
        data: list[Line] = [*_FRAMES, *_DATA]
        data += [f"CONST robtarget {name}:={self.literal()};" for name in _TAUGHT]
        data += [f"VAR robtarget {name}:={self.literal()};" for name in ("v1", "v2")]
        data.append(f"TASK PERS robtarget e1:={self.literal()};")
        data += [f"VAR robtarget {name}{{2}}:=[{self.literal()},{self.literal()}];" for name in ("vs", "ps")]
        data += [
            f"CONST robtarget cs{{2}}:=[{self.literal()},{self.literal()}];",
            "VAR robtarget q;",
            "VAR robtarget qs{2};",
        ]
        for kind, name, value in self.some(
            ("CONST pos", "u0", "p1.trans"), ("CONST num", "z0", "p2.trans.z"), ("CONST robtarget", "a1", "p1"),
            ("CONST pose", "d0", "[p1.trans,p1.rot]"), share=0.1,
        ):  # fmt: skip
            data.append(f"{kind} {name}:={value};")
        procedures = self.some("foo", "bar", "go", "setr", "up", share=0.4) + self.some("CutL", share=0.1)
        if "objects" in self.themes:
            procedures += self.some("calib", "calibf", share=0.6)
        functions = self.some("fi", "fz", "fr", share=0.35)
        self.trap = self.chance(0.12)
        self.sync = "foo" in procedures and self.chance(0.2)
        routines: list[list[Line]] = []
        self.calls = []
        for name in [*functions, *reversed(procedures)]:  # each calls those before it
            routines.append(self.routine(name))
            self.calls.append(name)
        if self.trap:
            self.locals, self.inner_nums = [], []
            calls, self.calls = self.calls, [one for one in self.calls if one in ("foo", "bar")]
            routines.append([Block([("TRAP tr", self.body(2))], "ENDTRAP")])
            self.calls = calls
        main = self.routine("main")
        modules = {"m.mod": [*data, *main, *(line for routine in routines for line in routine)]}
        if len(routines) > 1 and self.chance(0.2):
            half = len(routines) // 2
            local = [f"LOCAL CONST robtarget p1:={self.literal()};"] if self.chance(0.4) else []
            modules = {
                "m.mod": [*data, *main, *(line for one in routines[:half] for line in one)],
                "n.mod": [*local, *(line for one in routines[half:] for line in one)],
            }
        return {name: [Block([(f"MODULE {name[0]}", lines)], "ENDMODULE")] for name, lines in modules.items()}

    def some(self, *names, share: float):  # type: ignore[no-untyped-def]  # of anything
        """Return some of several things."""
        return [name for name in names if self.chance(share)]

    def literal(self) -> str:
        self.serial += 1
        x = 100 + 10 * self.serial
        q = self.dice.choice(["0,0,1,0", "1,0,0,0", "0.7071068,0,0.7071068,0"])
        return f"[[{x},{x % 70},{20 + x % 30}],[{q}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"

    # routines

    def routine(self, name: str) -> list[Line]:
        heads = {
            "main": "PROC main()", "foo": "PROC foo()", "bar": "PROC bar()", "go": "PROC go(robtarget r,num x)",
            "setr": "PROC setr(INOUT robtarget r)",
            "calib": f"PROC calib({self.dice.choice(['PERS', 'INOUT'])} wobjdata w)",
            "calibf": "PROC calibf(INOUT pose f)", "up": "PROC up(INOUT num x\\num y)", "fi": "FUNC num fi()",
            "CutL": "PROC CutL(robtarget r,num v,num z,PERS tooldata t\\PERS wobjdata WObj)",
            "fz": "FUNC num fz(robtarget r)", "fr": "FUNC robtarget fr(robtarget r)",
        }  # fmt: skip
        function = name in ("fi", "fz", "fr")
        errors = "errors" in self.themes
        self.in_function, self.handled = function, errors and self.chance(0.5)
        self.locals, self.inner_nums = [], []
        body: list[Line] = []
        if not function and self.chance(0.15):
            body.append(f"VAR robtarget y1:={self.dice.choice([self.point(), self.literal()])};")
            self.locals = ["y1"]
        if not function and self.chance(0.1):
            body.append(f"VAR num hn:={self.amount()};")
            self.inner_nums = ["hn"]
        if self.chance(0.05):
            body.append(f"VAR robtarget p1:={self.literal()};")
        if not function and self.chance(0.05):
            body.append("VAR robtarget ys{2}:=[p1,v1];")
            self.locals.append("ys{1}")
        if name == "main" and self.trap:
            body += ["CONNECT i1 WITH tr;"]
        if name in ("go", "CutL", "setr"):
            self.locals.append("r")
        size = 12 if name == "main" else self.dice.randint(1, 4)
        statements = self.body(size)
        if name == "up":
            statements.append("x:=x+1;")
        if name == "calib":
            statements.append(self.dice.choice(["w.uframe.trans.x:=500;", "w.oframe.trans.z:=h;", "b:=TRUE;"]))
        if name == "calibf":
            statements.append(self.dice.choice(["f.trans.x:=500;", "f:=d;", "b:=TRUE;"]))
        if name == "setr":
            statements.append(self.dice.choice([f"r:={self.goal(1)};", f"MoveL r{self.end()}"]))
        if name == "CutL":
            frame = self.dice.choice(["w1", "w2"])
            statements.append(
                self.dice.choice([f"MoveL r,v,z,t1\\WObj:={frame};", f"MoveL Offs(r,0,0,h),v,z,t1\\WObj:={frame};", PD])
            )
        if name == "main" and self.chance(0.6):
            statements += ["PDispOff;", "EOffsOff;", "CorrClear;"]
        if name == "fi":
            statements.append(self.dice.choice(["RETURN 1;", "RETURN 2;"]))
        if name == "fz":
            statements.append(self.dice.choice(["RETURN 1;", "RETURN r.trans.z;", "RETURN h;"]))
        if name == "fr":
            statements.append(self.dice.choice(["RETURN r;", "RETURN Offs(r,0,0,10);", "RETURN p1;"]))
        body += statements
        if self.handled:
            self.in_function = True  # no motions of functions, few statements
            body += ["ERROR", *(self.body(1) if self.chance(0.4) else [])]
            ending = self.dice.choice(["TRYNEXT;", "TRYNEXT;", "RETRY;", "RETURN;", "RAISE;"])
            body.append(ending if ending != "RETURN;" or not function else statements[-1])
        kind = heads[name].split()[0]
        return [Block([(heads[name], body)], f"END{kind}")]

    def body(self, size: int) -> list[Line]:
        self.depth += 1
        found: list[Line] = []
        for _ in range(self.dice.randint(1, size)):
            found += self.statement()
        self.depth -= 1
        return found

    # expressions

    def index(self) -> str:
        some = ["1", "2", "1", "2", "n", "k{1}", *self.counters]
        return self.dice.choice([*some, *(["fi()"] if "fi" in self.calls else [])])

    def point(self) -> str:
        """Return a point by its name."""
        names = [*_TAUGHT, *_TAUGHT, "v1", "v2", "e1", f"vs{{{self.index()}}}", f"cs{{{self.index()}}}"]
        return self.dice.choice([*names, *self.locals])

    def goal(self, depth: int = 0) -> str:
        if "offsets" in self.themes and self.chance(0.25) and depth < 2:
            return f"Offs({self.goal(depth + 1)},0,0,{self.amount()})"
        if "offsets" in self.themes and self.chance(0.08) and depth < 2:
            return f"RelTool({self.goal(depth + 1)},0,5,-10)"
        if self.chance(0.1):
            return self.literal()
        if "reads" in self.themes and self.chance(0.05):
            return f"[[{self.point()}.trans.y,80,{self.amount()}],p3.rot,p3.robconf,p3.extax]"
        if self.chance(0.05) and "fr" in self.calls and depth < 2:
            return f"fr({self.goal(depth + 1)})"
        if self.chance(0.1):
            return "q"
        return self.point()

    def amount(self) -> str:
        """Return a number."""
        some = ["10", "10", "25", "c1", "ck{2}", "h", "h+5", "2*c1", *self.inner_nums]
        if "reads" in self.themes and self.chance(0.25):
            some = [f"{self.point()}.trans.z", f"k{{{self.index()}}}", "kk{1}", "Abs(h)", "h"]
            some += [f"fz({self.goal(1)})"] if "fz" in self.calls else []
        return self.dice.choice(some)

    def condition(self) -> str:
        some = ["di1=1", "di1=1", "di2=1", "b", "h>12", "n=1", "NOT b"]
        if "reads" in self.themes and self.chance(0.25):
            some = [f"{self.point()}.trans.z>30", "h=0x1F", "di1=1 AND h>3", "(di1=1 OR b)", "StrToVal(s,h)"]
            some += ["fi()=1", "fi()=2 AND di1=1"] if "fi" in self.calls else []
            some += [f"fz({self.goal(1)})>2"] if "fz" in self.calls else []
        return self.dice.choice(some)

    def end(self) -> str:
        tool = "t2" if "two objects" in self.themes and self.chance(0.04) else "t1"
        frame = self.dice.choice(["w1"] * 9 + ["w2"]) if "two objects" in self.themes else "w1"
        return f",v100,z10,{tool}\\WObj:={frame};"

    # statements

    def statement(self) -> list[Line]:
        kinds = [self.move] * 9 + [self.assign] * 3 + [self.number] * 2 + [self.call] * 4
        kinds += [self.displace] * 2 if "displacements" in self.themes else []
        kinds += [self.rare] * 2
        if self.depth < 3:
            kinds += [self.branch] * 3 + [self.loop]
        return self.dice.choice(kinds)()

    def move(self) -> list[Line]:
        if self.in_function and self.chance(0.8):
            return ["b:=TRUE;"]
        if self.chance(0.06):
            return [f"MoveC {self.goal()},{self.goal()}{self.end()}"]
        if self.chance(0.04):
            return [f"SearchL di1,{self.dice.choice(['v1', 'q', 'vs{1}'])},{self.goal()},v100,t1\\WObj:=w1;"]
        if self.sync and self.chance(0.2) and not self.in_function and "foo" in self.calls:
            return [f'MoveLSync {self.goal()}{self.end()[:-1]},"foo";']
        return [f"{self.dice.choice(['MoveL', 'MoveJ'])} {self.goal()}{self.end()}"]

    def assign(self) -> list[Line]:
        left = self.dice.choice(
            ["q", "q", "q", "v1", "v2", "e1", f"vs{{{self.index()}}}", f"qs{{{self.index()}}}", *self.locals[:1]]
        )
        if self.chance(0.05):
            return [self.dice.choice(["ps:=vs;", "qs:=cs;", "vs:=ps;"])]
        if "components" in self.themes and self.chance(0.5) and not left.startswith("qs"):
            axis = self.dice.choice("xyz")
            source = left if self.chance(0.6) else self.point()
            right = f"{source}.trans.{axis}+{self.amount()}" if self.chance(0.7) else self.amount()
            return [f"{left}.trans.{axis}:={right};"]
        if self.chance(0.05):
            return [f"{left}.trans:={self.point()}.trans;"]
        if left == "q" and self.chance(0.7):
            return [f"q:={self.goal()};", f"MoveL q{self.end()}"]
        return [f"{left}:={self.goal()};"]

    def number(self) -> list[Line]:
        if self.chance(0.3):
            return [self.dice.choice(["n:=1;", "n:=2;", "n:=fi();" if "fi" in self.calls else "n:=1;"])]
        left = self.dice.choice(["h", "h", "h", f"kk{{{self.index()}}}", *self.inner_nums])
        if self.chance(0.06):
            return ["kk:=k;"]
        return [f"{left}:={self.amount()};"]

    def call(self) -> list[Line]:
        name = self.dice.choice([*(one for one in self.calls if one not in ("fi", "fz", "fr")), ""])
        arguments = {
            "go": f" {self.goal()},{self.amount()}", "setr": f" {self.dice.choice(['v1', 'q', 'e1', 'vs{1}'])}",
            "calib": f" {self.dice.choice(['w1', 'w2', 'w2'])}",
            "calibf": f" {self.dice.choice(['w1.oframe', 'w2.uframe', 'd'])}",
            "up": f" {self.dice.choice(['h', 'kk{1}', 'w2.oframe.trans.z'])}",
            "CutL": f" {self.goal()}{self.end()[:-1]}",
        }.get(name, "")  # fmt: skip
        if not name:
            return ["b:=TRUE;"]
        if name == "go" and self.chance(0.15):
            arguments = f" r:={self.goal()},x:={self.amount()}"
        if name == "up" and self.chance(0.3):
            arguments += f"\\y:={self.amount()}"
        called = f"{name}{arguments};"
        if self.chance(0.12):
            called = f'%"{name}"%{arguments};'
        return [f"IF {self.condition()} {called}"] if self.chance(0.15) else [called]

    def displace(self) -> list[Line]:
        if self.chance(0.5):
            return [PD, *self.statement(), "PDispOff;"]
        if self.chance(0.2):
            return ["CorrCon id1;", *(["WaitDI di1,1\\MaxTime:=1;"] if self.chance(0.5) else []), "CorrClear;"]
        return [self.dice.choice([PD, "PDispOff;", "PDispOff;", "PDispSet d;"])]

    def rare(self) -> list[Line]:
        some = ["<SMT>", "Stop;", "ConfL\\Off;", "b:=TRUE;", "WaitTime 1;"]
        if "errors" in self.themes:
            some += ["WaitDI di1,1\\MaxTime:=1;"] * 4
        if "reads" in self.themes:
            some += [
                f'TPWrite "h"\\Num:={self.amount()};', f"SetAO ao1,{self.amount()};", "u:=p2.trans;", "d.trans:=u;",
                f"MoveAbsJ CalcJointT({self.goal()},t1\\WObj:=w1),v100,z10,t1;",
                f"h:=Distance({self.point()}.trans,u);",
            ]  # fmt: skip
        if "measured" in self.themes:
            some += ["b:=StrToVal(s,h);", "GetSysData t2;", "Incr h;", "Add h,c1;", "b:=StrToVal(s,q);",
                     "q:=CRobT(\\Tool:=t1\\WObj:=w1);", "b:=StrToVal(s,w2);"]  # fmt: skip
        if "objects" in self.themes:
            some += [
                "w2.oframe.trans.z:=500;",
                f"w2.oframe.trans.x:={self.amount()};",
                "w2:=w1;",
                "w1.uframe.trans.y:=h;",
            ]
        if self.chance(0.1) and self.depth == 1 and not self.in_function:
            self.serial += 1
            label = f"l{self.serial}"
            return [f"IF di1=1 GOTO {label};", *self.statement(), f"{label}:", "b:=TRUE;"]
        if "errors" in self.themes and self.chance(0.2):
            return [self.dice.choice(["IF di1=1 RAISE 1;", f"IF di1=1 THEN\n{PD}\nRAISE 1;\nENDIF"])]
        if self.chance(0.1) and not self.in_function:
            return [self.dice.choice(["IF di1=1 RETURN;", "IF di1=1 EXITCYCLE;"])]
        return [self.dice.choice(some)]

    def branch(self) -> list[Line]:
        if self.chance(0.2):
            arms: list[tuple[str, list[Line]]] = [(f"TEST {self.dice.choice(['n', 'h', 'n'])}", [])]
            cases = [
                "1",
                self.dice.choice(
                    ["2", "fi()" if "fi" in self.calls else "2", "p1.trans.x" if self.chance(0.2) else "2"]
                ),
            ]
            arms += [(f"CASE {case}:", self.body(2)) for case in cases]
            return [Block([*arms, ("DEFAULT:", self.body(1))] if self.chance(0.5) else arms, "ENDTEST")]
        arms = [(f"IF {self.condition()} THEN", self.body(2))]
        if self.chance(0.2):
            arms.append((f"ELSEIF {self.condition()} THEN", self.body(2)))
        if self.chance(0.4):
            arms.append(("ELSE", self.body(2)))
        return [Block(arms, "ENDIF")]

    def loop(self) -> list[Line]:
        if self.chance(0.4):
            return [
                Block([(f"WHILE {self.condition() if self.chance(0.3) else 'di1=1'} DO", self.body(2))], "ENDWHILE")
            ]
        self.serial += 1
        counter = f"i{self.serial}"
        self.counters.append(counter)
        body = self.body(2)
        self.counters.pop()
        return [Block([(f"FOR {counter} FROM 1 TO 2 DO", body)], "ENDFOR")]


def random_task(dice: Random) -> dict[str, list[Line]]:
    """Return the modules of a random task, by file name."""
    return Generator(dice).task()

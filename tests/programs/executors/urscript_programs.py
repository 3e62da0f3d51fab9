"""Random URScript programs: each uses a few of the constructs that could mislead a reader, among many plain motions."""

from __future__ import annotations

from random import Random

TCPS = ("p[0,0,0.1,0,0,0]", "p[0,0,0.2,0,0,0]", "p[0.05,0,0.2,0,0.5,0]")
CONSTRUCTS = (
    "function", "argument", "named", "optional", "thread", "loop", "branch", "jump", "tcp", "tcp-argument", "feature",
    "shift", "inverse", "list", "copy", "write", "number", "condition", "logic", "output", "force", "measured", "local",
    "return", "joints", "circle", "one-line", "like-a-motion", "inner", "twice", "order",
)  # fmt: skip

OF_FUNCTIONS = (
    "argument", "named", "optional", "tcp-argument", "return", "like-a-motion", "inner", "twice", "order", "local",
    "condition",
)  # fmt: skip
THEMES = (
    ("argument", "measured", "shift"), ("argument", "feature", "number"), ("thread", "force", "function"),
    ("thread", "tcp", "function"), ("loop", "jump", "branch", "tcp"), ("loop", "jump", "branch", "force"),
    ("tcp-argument", "argument"), ("named", "tcp"), ("optional", "argument"), ("like-a-motion", "argument"),
    ("condition", "branch", "tcp"), ("condition", "loop", "tcp"), ("order", "tcp", "function"), ("logic", "condition"),
    ("inverse", "number"), ("inverse", "tcp"), ("copy", "branch"), ("copy", "write", "shift"), ("list", "loop"),
    ("list", "copy", "write"), ("number", "branch"), ("inner", "argument"), ("local", "inner"), ("return", "argument"),
    ("output", "argument"), ("circle", "feature"), ("joints", "argument"), ("one-line", "tcp"), ("twice", "tcp"), (),
)  # fmt: skip
"""Constructs that are misread together."""


Function = tuple[str, list[tuple[str, str]], bool]
"""The name, the names and kinds of the parameters, and whether it returns a pose."""


class Writer:
    """Writes one program.

    Parameters
    ----------
    random : Random
        The source of its choices.
    """

    def __init__(self, random: Random) -> None:
        self._random = random
        self._theme = random.choice(THEMES)
        self._on = {*self._theme, *random.sample(CONSTRUCTS, random.randrange(4))}
        if not self._on.isdisjoint(OF_FUNCTIONS):
            self._on.add("function")
        self._lines: list[str] = []
        self._poses = ["w1", "w2", "w3", "w4", "w5"]
        self._numbers = ["n"]
        self._tcps: list[str] = []
        self._features: list[str] = []
        self._lists: list[str] = []
        self._joints: list[str] = []
        self._functions: list[Function] = []
        self._threads: list[str] = []
        self._loops = self._count = self._left = 0

    def _is(self, construct: str, chance: float = 1.0) -> bool:
        return construct in self._on and self._random.random() < chance * (1.6 if construct in self._theme else 1.0)

    def _put(self, depth: int, text: str) -> None:
        self._lines.append("  " * depth + text)

    def _new(self, stem: str) -> str:
        self._count += 1
        return f"{stem}{self._count}"

    def program(self) -> str:
        """Return the text."""
        random = self._random
        self._put(0, "def prog():")
        for name in self._poses:
            self._put(1, random.choice(["", "global "]) + f"{name}={self._literal()}")
        self._put(1, f"n={random.randrange(2)}")
        if self._is("feature"):
            self._features = ["g1", "Plane_1"]
            self._put(1, f"g1={self._literal()}")
        if self._is("tcp-argument") or self._is("tcp", 0.3):
            self._tcps = ["t1", "t2"]
            self._put(1, f"t1={TCPS[0]}")
            self._put(1, f"t2={random.choice(TCPS)}")
        if self._is("list"):
            self._lists = ["pts"]
            self._put(1, f"pts=[{self._literal()}, {self._literal()}]")
        if self._is("joints"):
            self._joints = ["q1"]
            self._put(1, "q1=[0.1,-1.5,1.2,-1.3,-1.5,0.2]")
        if self._is("measured"):
            self._put(1, "off=get_actual_tcp_pose()")
        for _ in range(random.randrange(1, 4) if "function" in self._on else 0):
            self._function(1)
        if self._is("thread"):
            self._thread()
        self._put(1, f"set_tcp({TCPS[0]})")
        self._block(1, random.randrange(5, 13))
        self._put(0, "end")
        return "\n".join(self._lines) + "\n"

    def _literal(self) -> str:
        if self._is("number", 0.1) and self._numbers:
            return f"p[{self._number()},0.1,0.2,0,3,0]"
        values = [round(self._random.uniform(-0.6, 0.6), 3) for _ in range(3)]
        turn = self._random.choice([(0, 3, 0), (0.2, 2.5, 0.1), (0, 0, 0)])
        return "p[" + ",".join(map(str, (*values, *turn))) + "]"

    def _constant(self) -> str:
        return self._random.choice(["p[0,0,0.05,0,0,0]", "p[0.02,0,0,0,0,0]", "p[0,0,0.05,0,0,0.3]"])

    def _pose(self, deep: int = 0) -> str:
        """Return an expression of a pose."""
        random = self._random
        if deep < 2:
            if self._is("feature", 0.1):
                return f"pose_trans({random.choice(self._features)},{self._pose(deep + 1)})"
            if self._is("shift", 0.07):
                by = "off" if self._is("measured", 0.4) else self._constant()
                return f"{random.choice(['pose_add', 'pose_trans'])}({self._pose(deep + 1)},{by})"
            if self._is("measured", 0.03):
                return f"pose_{random.choice(['add', 'trans'])}(off,{self._pose(deep + 1)})"
            if self._is("shift", 0.04):
                return f"pose_inv({self._pose(deep + 1)})"
            if self._is("return", 0.15) and (giving := [one for one in self._functions if one[2]]):
                return self._call(random.choice(giving), deep + 1)
        if self._lists and self._is("list", 0.3):
            index = "n" if self._is("number", 0.3) else str(random.randrange(2))
            if self._is("number", 0.05):
                index = f"{random.choice(self._poses)}[0]*0"
            return f"{random.choice(self._lists)}[{index}]"
        return random.choice(self._poses) if random.random() < 0.75 else self._literal()

    def _number(self, deep: int = 0) -> str:
        random = self._random
        if self._is("number", 0.12):
            return f"{random.choice(self._poses)}[{random.randrange(3)}]"
        if self._is("number", 0.1):
            return f"pose_dist({self._pose(2)},{self._pose(2)})"
        if self._is("order", 0.2) and self._functions and deep < 2:
            return self._call(random.choice(self._functions), deep + 1)
        return random.choice([*self._numbers, "0.2", "1", "read_input(1)"])

    def _condition(self, deep: int = 0) -> str:
        if self._is("logic", 0.3) and deep < 2:
            parts = (self._condition(deep + 1), self._condition(deep + 1))
            return f"{parts[0]} {self._random.choice(['and', 'or'])} {parts[1]}"
        if self._is("condition", 0.4) and self._functions:
            return f"{self._call(self._random.choice(self._functions), 1)} == 0"
        if self._is("number", 0.2):
            return f"{self._number()} > 0.1"
        return self._random.choice(["get_digital_in(1)", "get_digital_in(2)", "n == 0", "not get_digital_in(3)"])

    def _call(self, function: Function, deep: int = 0) -> str:
        name, kinds, _ = function
        given = []
        for key, kind in kinds:
            if kind == "optional" and self._random.random() < 0.5:
                continue
            value = {
                "pose": lambda: self._pose(deep + 1),
                "optional": lambda: self._pose(deep + 1),
                "tcp": lambda: self._random.choice([*self._tcps, *TCPS, *self._poses[:1]]),
                "number": lambda: self._number(deep + 1),
                "feature": lambda: self._random.choice([*self._features, self._literal(), *self._poses[:1]]),
            }[kind]()
            named = self._is("named", 0.5) or len(given) < kinds.index((key, kind)) or (given and "=" in given[-1][:3])
            given.append(f"{key}={value}" if named else value)
        return f"{name}({', '.join(given)})"

    def _function(self, depth: int) -> None:
        random = self._random
        name = self._new("movel_f" if self._is("like-a-motion", 0.5) else "f")
        kinds = [
            kind
            for kind, chance in (("pose", 0.7), ("tcp", 0.5), ("number", 0.3), ("feature", 0.4))
            if random.random() < chance and (kind == "pose" and self._is("argument")) | (kind == "number")
            | (kind == "tcp" and self._is("tcp-argument")) | (kind == "feature" and self._is("feature"))
        ]  # fmt: skip
        kinds += ["optional"] if self._is("optional", 0.6) else []
        keys = [f"a{k}" for k in range(len(kinds))]
        if self._is("inner", 0.5) and "pose" in kinds:  # hides a variable of the program
            keys[kinds.index("pose")] = random.choice(["w1", "w2"])
        default = random.choice([*self._poses, "p[0.1,0.2,0.3,0,3,0]"])
        listed = ", ".join(
            key if kind != "optional" else f"{key}={default}" for key, kind in zip(keys, kinds, strict=True)
        )
        self._put(depth, f"def {name}({listed}):")
        kept = [list(one) for one in self._scopes()]
        for key, kind in zip(keys, kinds, strict=True):
            {
                "pose": self._poses, "optional": self._poses, "tcp": self._tcps, "number": self._numbers,
                "feature": self._features,
            }[kind].append(key)  # fmt: skip
            if kind in ("pose", "optional"):
                self._poses.append(key)
        if self._is("inner", 0.4) and depth < 3:
            self._function(depth + 1)
        if self._is("local", 0.4):
            self._put(depth + 1, f"local {random.choice(['w1', 'w2', 'x1'])}={self._pose()}")
        loops, self._loops = self._loops, 0
        self._block(depth + 1, random.randrange(1, 4))
        self._loops = loops
        gives = self._is("return", 0.7)
        if gives:
            self._put(depth + 1, f"return {self._pose(1)}")
        self._put(depth, "end")
        for one, before in zip(self._scopes(), kept, strict=True):
            one[:] = before
        self._functions.append((name, list(zip(keys, kinds, strict=True)), gives))
        if self._is("twice", 0.3):
            kept = [list(one) for one in self._scopes()]
            self._put(depth, f"def {name}({listed}):")
            self._block(depth + 1, 2)
            if gives:
                self._put(depth + 1, f"return {self._pose(1)}")
            self._put(depth, "end")
            for one, before in zip(self._scopes(), kept, strict=True):
                one[:] = before

    def _scopes(self) -> tuple[list, ...]:
        return self._poses, self._tcps, self._numbers, self._features, self._lists, self._joints, self._functions

    def _thread(self) -> None:
        name = self._new("t")
        self._put(1, f"thread {name}():")
        kept = [list(one) for one in self._scopes()]
        self._block(2, self._random.randrange(1, 4))
        for one, before in zip(self._scopes(), kept, strict=True):
            one[:] = before
        self._put(1, "end")
        self._threads.append(name)

    def _block(self, depth: int, statements: int) -> None:
        for _ in range(statements):
            self._statement(depth)

    def _motion(self) -> str:
        random = self._random
        more = f", v={self._number()}" if self._is("order", 0.4) else random.choice(["", ", a=1.2, v=0.25"])
        if self._is("joints", 0.15):
            return f"movej({random.choice([*self._joints, '[0.2,-1.4,1.1,-1.2,-1.5,0.1]'])}{more})"
        if self._is("circle", 0.2):
            return f"movec({self._pose()}, {self._pose()}{more})"
        if self._is("inverse", 0.3):
            near = random.choice(["", ", qnear=[0,0,0,0,0,0]", ", [n,0,0,0,0,0]"])
            near = f", [{random.choice(self._poses)}[0],0,0,0,0,0]" if self._is("number", 0.2) else near
            return f"movej(get_inverse_kin({self._pose()}{near}){more})"
        word = random.choice(["movel", "movel", "movej", "movep"])
        key = "q" if word == "movej" else "pose"
        return f"{word}({f'{key}=' if self._is('named', 0.2) else ''}{self._pose()}{more})"

    def _statement(self, depth: int) -> None:
        random = self._random
        if depth < 4 and self._is("branch", 0.18):
            self._put(depth, f"if {self._condition()}:")
            self._block(depth + 1, random.randrange(1, 3))
            while random.random() < 0.3:
                self._put(depth, f"elif {self._condition()}:")
                self._block(depth + 1, random.randrange(1, 3))
            if random.random() < 0.4:
                self._put(depth, "else:")
                self._block(depth + 1, random.randrange(1, 3))
            self._put(depth, "end")
        elif depth < 4 and self._is("loop", 0.2):
            self._put(depth, f"while {self._condition()}:")
            self._loops += 1
            self._block(depth + 1, random.randrange(1, 4))
            self._loops -= 1
            self._put(depth, "end")
        elif self._is("tcp", 0.12):
            self._excursion(depth, f"set_tcp({random.choice(TCPS[1:])})", f"set_tcp({TCPS[0]})")
        elif self._is("force", 0.12):
            self._excursion(depth, "force_mode()", "end_force_mode()")
        elif self._is("one-line", 0.1):
            self._put(depth, f"if {self._condition()}: {self._simple()} end")
        elif self._loops and self._is("jump", 0.3):
            self._put(depth, f"if {self._condition()}:")
            self._put(depth + 1, random.choice(["break", "continue", "continue"]))
            self._put(depth, "end")
        elif self._is("jump", 0.03):
            self._put(depth, random.choice(["return", "halt", "break" if self._loops else "halt"]))
        else:
            self._put(depth, self._simple())

    def _excursion(self, depth: int, begin: str, end: str) -> None:
        self._put(depth, begin)
        self._block(depth, self._random.randrange(3))
        self._put(depth, end)

    def _simple(self) -> str:
        """Return a statement of one line."""
        random, name = self._random, self._random.choice(self._poses)
        if self._is("tcp", 0.06):
            return f"set_tcp({random.choice([*TCPS, *self._tcps, *(self._poses if self._is('copy', 0.2) else [])])})"
        if self._functions and random.random() < 0.3:
            return self._call(random.choice(self._functions))
        if self._threads and random.random() < 0.25:
            return f"run {random.choice(self._threads)}()"
        if self._is("copy", 0.12):
            target = random.choice([name, self._new("c")])
            text = f"{random.choice(['', '', 'global '])}{target}={self._pose()}"
            self._poses.append(target)
            return text
        if self._is("list", 0.06) and self._is("copy"):
            self._lists.append(self._new("l"))
            return f"{self._lists[-1]}={self._lists[0]}" if self._lists[0] != self._lists[-1] else "n=0"
        if self._is("list", 0.05) and self._lists and self._is("write"):
            return f"{random.choice(self._lists)}[{random.randrange(2)}]={self._pose()}"
        if self._is("write", 0.08):
            k = random.randrange(3)
            value = random.choice([f"{name}[{k}]+0.05", self._number(), f"{random.choice(self._poses)}[{k}]+0.05"])
            return f"{name}[{k}]={value}"
        if self._is("number", 0.1):
            return f"n={self._number()}"
        if self._is("logic", 0.08):
            return f"b={self._condition()}"
        if self._is("inverse", 0.12):
            self._joints.append(self._new("j"))
            return f"{self._joints[-1]}=get_inverse_kin({self._pose()})"
        if self._is("inverse", 0.2) and self._joints:
            return f"movej({random.choice(self._joints)})"
        if self._is("output", 0.12):
            return random.choice([f"textmsg({self._number()})", f"textmsg({self._pose(2)})", f"tell({self._pose(1)})"])
        if self._is("force", 0.04):
            return random.choice(["force_mode()", "end_force_mode()", "path_offset_enable()", "path_offset_disable()"])
        return self._motion()


def write(random: Random) -> str:
    """Return a random program."""
    return Writer(random).program()

"""Arms of the library for tests that take longer: the first fifteen, and one of each further maker."""

FIRST = [
    "kuka-kr150-2",
    "kuka-kr210-r2700-extra",
    "kuka-kr10-r1100-sixx",
    "abb-irb120",
    "abb-irb1600-10-145",
    "abb-irb6640-185-280",
    "abb-irb6700-200-260",
    "fanuc-m20ia",
    "fanuc-lrmate200id",
    "fanuc-m900ia-260l",
    "staubli-tx2-90",
    "universal-robots-ur5",
    "universal-robots-ur5e",
    "universal-robots-ur10",
    "universal-robots-ur10e",
]
FURTHER = [
    "comau-racer-7-14",
    "denso-vs-060",
    "doosan-m1013",
    "epson-c8-a901",
    "hyundai-hh020",
    "kawasaki-rs007l",
    "mitsubishi-rv7frl",
    "nachi-mz07f",
    "yaskawa-gp25",
]
ARMS = sorted(FIRST + FURTHER)

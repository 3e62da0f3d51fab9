"""Run a command of truepose from another program: show its steps, and take its result or its problem."""

import json
import os
import subprocess
import sys
import tempfile

name, *arguments = sys.argv[1:]
settings = {
    "env": {**os.environ, "TRUEPOSE_EVENTS": "json", "PYTHONIOENCODING": "utf-8"},
    "stdin": subprocess.PIPE,  # kept open: the command ends when this program ends
    "stderr": subprocess.PIPE,
    "encoding": "utf-8",
}
problem = None
with tempfile.TemporaryFile() as output:
    command = [sys.executable, "-m", "truepose", name, "--json", *arguments]
    with subprocess.Popen(command, stdout=output, **settings) as process:
        for line in process.stderr:
            try:
                event = json.loads(line)
            except ValueError:
                continue  # a text of another library
            if event["event"] == "step":
                print("step:", event["step"])
            elif event["event"] == "count":
                print(f"  {event['done']} of {event['total']}")
            elif event["event"] == "warning":
                print("warning:", event["message"])
            elif event["event"] == "problem":
                problem = event
    output.seek(0)
    result = output.read()

if problem is not None:
    print(f"{problem['title']}: {problem['detail']}")
if result:
    print("result:", ", ".join(json.loads(result)))

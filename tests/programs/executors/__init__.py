"""Direct execution of random programs, one module for each language: the oracle of the readers.

A random program runs with its own numbers and with a known shift of each target that truepose corrects. Nothing but
motions to such a target may differ, each by just its shift in the frame that truepose states, and the tool and frame in
force at the motion must be the stated ones in every run.
"""

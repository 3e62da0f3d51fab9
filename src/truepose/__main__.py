"""The command line as ``python -m truepose``, where the folder of scripts is not on the path."""

from truepose.cli import main

if __name__ == "__main__":
    main()

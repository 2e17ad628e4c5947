"""`python -m obsdesign`."""

from obsdesign.cli.main import main

if __name__ == "__main__":
    main()

"""python -m elastid."""

from elastid.cli import main

if __name__ == "__main__":
    main()

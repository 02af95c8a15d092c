"""python -m elastid."""

from elastid.app.cli import main

if __name__ == "__main__":
    main()

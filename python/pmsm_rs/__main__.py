"""`python -m pmsm_rs`: the command line."""

from .cli import main

if __name__ == "__main__":
    main()

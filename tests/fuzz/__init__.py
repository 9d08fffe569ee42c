"""Every reader against files that are damaged at random.

    python -m tests.fuzz --cases 100000 --seed 1

changes the small files of `samples` in the ways of `mutations` and reads them, with limits on memory and time. Readers
may succeed or raise InputError with a sentence fit for a terminal; whatever else happens is a defect, listed with the
numbers that repeat it:

    python -m tests.fuzz --seed 1 --reader sog --case 4711 --keep out/defects

`--reader` may be repeated; `--keep` saves the files of each defect. If the process dies, the end of standard error
names the case. A case is settled by seed, reader and number, and by the samples, which are those of the writers.
"""

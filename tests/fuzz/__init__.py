"""Every reader against files that were made to hurt it.

    python -m tests.fuzz --cases 100000 --seed 1

takes the small files of `samples`, changes each case's in the ways of `mutations`, and has them read in a child
process with limits on memory and time. A reader may succeed or raise InputError with a sentence fit for a terminal;
whatever else happens is a defect, listed with the command that repeats it:

    python -m tests.fuzz --seed 1 --reader sog --case 4711 --keep out/defects

`--reader` may be repeated; `--keep` saves the files of each defect. The suite runs a few thousand cases of seed 0. A
case is settled by seed, reader and number alone, but the samples are those of the writers, so that a change of a
writer changes the cases.
"""

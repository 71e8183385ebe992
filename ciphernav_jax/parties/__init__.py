"""How one party's program is run and watched: simulated, or with a device or a process for each party.

In import order:
- `party`: the party axis, its collectives, and who runs a program.
- `sharing`: additive shares and shares by exclusive or.
- `requests`: what a program asks the dealer for.
- `dealer`: the plan of it, and its generation.
- `repeat`: randomness for the bodies of loops and for branches.
- `jaxprs`: what the equations of a traced program wrap, and under which names they stand.
- `locality`: that nothing but openings crosses, and at the same points for all.
- `run`: a program together with its dealer, planned, dealt and run.
- `messages`: all openings of a traced program with their rounds.
- `recording`: a run that keeps what is sent and opened.
"""

"""Every table and figure of the paper at its full size, and past it. Each script is run by name, as in

    python -m experiments paper accuracy --rows plaintext --seeds 0

and says at its head what the paper has, how long it takes, and what it writes. In reading order:

- `runs`: the data sets; a row of a table, trained, driven, and written as one JSON file a seed.
- `accuracy`: success, failures, efficiency and path lengths of every method.
- `paper_recipe`: the classifier trained as the paper says.
- `fewest_steps`: how little secret training passes the paper's accuracy.
- `beyond`: past the paper's accuracy.
- `bounds`: what a robot could reach that knows the map alone, or what it sees at the start.
- `forward`: seconds of a forward pass.
- `variants`: variants of the protocols compared, and trained with.
- `attack`: the attackers, and their scores.
- `reconstruction`: is an obstacle in a camera's view? From features, shares, and all that parties see.
- `exact`: the attacker who looks for masks that are used twice.
- `own_runs`: both attackers on a training and its drives together, with their own keys.
- `queries`: what the answers to all questions tell about obstacles.
- `episodes`: pictures of episodes, and what each party saw of one.
"""

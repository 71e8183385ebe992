from hypothesis import settings

# Compilation in the first example is no deadline's business; the same examples run every time.
settings.register_profile("ring", deadline=None, derandomize=True, max_examples=60, database=None)
settings.load_profile("ring")

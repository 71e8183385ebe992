"""The command `report`: all results beside the paper's, on a page and as tables. In reading order:

- `results`: what the JSON files hold, the runs of a row together; means and standard deviations over seeds.
- `table`: a table as text, what rows are called, and which commands make them.
- `driving`, `costs`, `attacks`, `engine`, `minutes`: each table.
- `listing`: all of them.
- `figures`: each figure.
- `shown`: episodes, and what each party saw of one.
- `page`: the page.
- `write`: all files of the report.
"""

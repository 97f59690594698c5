"""A labelled set as a regression test: golden, good and bad recordings inspected, counted, compared, shown.

The figures themselves are `models.labelled` and `models.comparison`. A truth and a labelled set are read, the parts
run, put beside a baseline, and told: as a record (JSON), a summary (text), or a page (HTML).
"""

"""Identification of the table and of the specimen on it from measured responses.

`excitation` makes the command, `driving` moves a table with it, `frequency_response` has spectra with coherence,
`rational_fit` fits a transfer function, `table_model` and `specimen_model` say what a table and a specimen are.
"""

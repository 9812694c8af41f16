"""Identification of the table and of the specimen on it from measured responses.

`excitation` makes the command, `driving` moves a table with it, `frequency_response` has averages and coherence,
`spectral_lines` single ones, `rational_fit` fits transfer functions that `vector_fitting` begins, `table_model` and
`specimen_model` put them together, and `output` is what other commands read.
"""

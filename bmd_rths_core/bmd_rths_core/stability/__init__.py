"""Stability of the loop as an allowable mass ratio (Eqs. 7 and 8).

`continuous` has the transfer function of the paper, made of `models`; `discrete` has the loop as it runs; `assessment`
puts them side by side and says go or no-go.
"""

"""Judgement of a run: metrics, reference building, pre-flight, replay."""

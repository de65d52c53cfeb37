"""Functional scenarios and their parts: streets, people, road users, and changes of a test.

`functional` has the schema of a scenario, `streets` the layout of its town, `people` its
pedestrians, and `front_car` the snapshots of the front-car study.
"""

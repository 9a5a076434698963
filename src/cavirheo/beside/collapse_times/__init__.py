"""Tables of collapse times and curves -> G and mu of each material, by the quick estimate (physics/collapse.py).

| module | does |
|---|---|
| read | CSV, Excel and .mat tables of (R_max, lambda, t_1), or curves -> groups of shots |
| record | the estimates -> collapse-time.json, shots.csv |
| table | the terminal |
| picture | measured and model t_1/t_RC (needs the [plot] extra) |
| command | `cavirheo collapse-time` |
"""

"""Tables of collapse times and curves -> G and mu of each material, by the quick estimate (inference/collapse_time).

| module | does |
|---|---|
| read | CSV, Excel and .mat tables of (R_max, lambda, t_1), or curves -> groups of shots |
| document | the groups and their estimates: collapse-time.json, shots.csv, the terminal |
| picture | measured and model t_1/t_RC (needs the [plot] extra) |
"""

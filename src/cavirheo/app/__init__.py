"""The browser app: five guided steps over the same functions as the command line (docs/how-to/app.md).

| module | does |
|---|---|
| server | the page on a port: limits, headers, nothing from outside, temporary files |
| page | the five steps: what stands where, and which handler answers what |
| endpoint | what comes from outside: uploads, and file in, result.json out for programs |
| steps | what the buttons do |
| session | what one visitor has: files, curves, answers; the limits |
| apart | files are read in a process of its own, which a hostile file may exhaust or end |
| plots | interactive figures |
| words | tables and facts as HTML |
| export | everything in one zip |
"""

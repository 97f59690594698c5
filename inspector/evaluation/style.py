"""How the page looks: light and dark, on a screen, a tablet and paper. Text has a contrast of 4.5 to 1 at the least."""

STYLE = """
:root { color-scheme: light dark; --paper: #fff; --panel: #f4f6f8; --ink: #1c2228; --faint: #545e69; --rule: #d3d9df;
  --good: #0a5fa8; --bad: #8a4b00; --wrong: #b3261e; --limit: #b3261e; --defect: #f6dfb4; }
@media (prefers-color-scheme: dark) { :root { --paper: #14181d; --panel: #1e242b; --ink: #e7eaee; --faint: #a7b1bb;
  --rule: #3a434d; --good: #7fb9f5; --bad: #f0b35a; --wrong: #ff9b91; --limit: #ff9b91; --defect: #4a3a18; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 76rem; padding: 1.5rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.2rem 0 .7rem; padding-bottom: .25rem; border-bottom: 1px solid var(--rule); }
h3 { font-size: 1.05rem; margin: 1.4rem 0 .5rem; }
p { margin: .4rem 0; max-width: 50rem; }
.faint, figcaption, caption, small { color: var(--faint); }
.id { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .85em; overflow-wrap: anywhere; }
.wrong { color: var(--wrong); font-weight: 600; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(10rem, 1fr)); gap: .8rem; margin: 1.2rem 0;
  padding: 0; list-style: none; }
.tiles li { background: var(--panel); border: 1px solid var(--rule); border-radius: .4rem; padding: .7rem .9rem; }
.tiles b { display: block; font-size: 1.5rem; line-height: 1.3; font-variant-numeric: tabular-nums; }
.beside { display: flex; flex-wrap: wrap; gap: 0 2.5rem; align-items: flex-start; }
.wide { overflow-x: auto; margin-bottom: 1rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding: .2rem 0; }
th, td { text-align: left; vertical-align: top; padding: .3rem .9rem .3rem 0; border-bottom: 1px solid var(--rule); }
th { font-weight: 600; }
tbody th small { display: block; font-weight: 400; max-width: 24rem; }
.number { text-align: right; white-space: nowrap; }
.alarm { border: 2px solid var(--wrong); border-radius: .4rem; padding: .6rem .9rem; margin: 1rem 0; }
figure { margin: 1rem 0 2rem; break-inside: avoid; }
figure img { display: block; max-width: 100%; height: auto; border: 1px solid var(--rule); margin: .5rem 0; }
svg { display: block; max-width: 100%; height: auto; }
svg text { fill: var(--faint); font: 12.5px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
svg .grid { stroke: var(--rule); } svg .limit { stroke: var(--limit); stroke-width: 1.5; stroke-dasharray: 6 3; }
svg .frame { fill: none; stroke: var(--rule); } svg .defect { fill: var(--defect); }
svg .curve { fill: none; stroke: var(--good); stroke-width: 2.5; stroke-linejoin: round; }
svg .dashed { stroke: var(--bad); stroke-dasharray: 7 4; } svg .thin { stroke: var(--ink); stroke-width: 1.3; }
svg .good { fill: var(--good); } svg .bad { fill: var(--bad); }
svg .wrong { fill: none; stroke: var(--wrong); stroke-width: 2.5; }
@media print { body { max-width: none; padding: 0; font-size: .85rem; } .wide { overflow: visible; } }
"""

"""How the pages of runs look, in light and in dark."""

STYLE = """
:root{color-scheme:light dark;--ink:#1d2329;--soft:#5f6b76;--line:#d9dee3;--paper:#fff;--tile:#f3f5f7;--blue:#1f6fd6;
--green:#1d9a6c;--red:#c83232}
@media(prefers-color-scheme:dark){:root{--ink:#e8ebee;--soft:#9aa6b2;--line:#3a434c;--paper:#15191d;--tile:#20262c;
--blue:#6aa8ff;--green:#4fd1a0;--red:#ff7b7b}}
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
main{max-width:940px;margin:0 auto;padding:24px 20px 60px}
h1{font-size:26px;margin:0 0 6px}h2{font-size:18px;margin:36px 0 10px}
h3{font-size:13px;font-weight:500;color:var(--soft);margin:14px 0 0}
.ending{font-size:17px;margin:0 0 20px;padding:10px 14px;border-left:5px solid;background:var(--tile);border-radius:4px}
.fine{border-color:var(--green)}.bad{border-color:var(--red)}
.tiles{display:grid;grid-template-columns:repeat(auto-fill,minmax(150px,1fr));gap:10px}
.tiles div{background:var(--tile);border-radius:6px;padding:10px 12px}
.tiles b{display:block;font-size:19px;font-variant-numeric:tabular-nums;white-space:nowrap}
.tiles span{color:var(--soft);font-size:13px}
svg{display:block;width:100%;height:auto}svg text{fill:var(--soft);font:12px system-ui,sans-serif}
svg.map{--blue:#1f6fd6;--green:#12855a;--soft:#4d5964;--ink:#1d2329;background:#c4c9ce;border-radius:6px;margin:0 auto}
.grid{stroke:var(--line)}line.mark{stroke:var(--red);stroke-dasharray:5 4;opacity:.6}
polyline{fill:none;stroke-width:1.6}.curve{stroke:var(--blue)}.event{fill:var(--ink)}
polyline.estimate{stroke:var(--blue);stroke-width:2.5}
polyline.truth{stroke:var(--green);stroke-width:2;stroke-dasharray:6 4}
circle.estimate{fill:var(--blue)}circle.truth{fill:var(--green)}
.dots{stroke:var(--soft);stroke-width:2;stroke-linecap:round;opacity:.45}.bar{stroke:var(--ink);stroke-width:3}
.legend{color:var(--soft);font-size:13px;margin:6px 0}.legend span{margin-right:18px}
.key::before{content:"";display:inline-block;width:18px;height:4px;margin-right:6px;vertical-align:middle;
background:var(--c)}
.key.estimate{--c:#1f6fd6}.key.truth{--c:#12855a}.key.points{--c:#4d5964}
table{border-collapse:collapse;width:100%;font-size:13.5px;font-variant-numeric:tabular-nums}
td,th{text-align:left;padding:4px 10px 4px 0;border-bottom:1px solid var(--line);vertical-align:top}
td:first-child{white-space:nowrap}
pre{overflow:auto;background:var(--tile);padding:10px 12px;border-radius:6px;font-size:13px}
summary{cursor:pointer;color:var(--blue);margin:8px 0}i{color:var(--soft)}
"""

//! The style sheet of every report.

/// Two palettes by preference; figures use the same custom properties as the text.
pub(super) const CSS: &str = "
:root{--bg:#fbfaf8;--panel:#ffffff;--ink:#1d2126;--soft:#5d6672;--faint:#8b95a1;--line:#e4e2dd;--accent:#b4530a;--accent-soft:#f7e7d8;
--a:#b4530a;--b:#2f6fab;--c:#4b8b3b;--d:#8a5aa8;--e:#c2883a;--f:#5b7f8c;--g:#a84a5b;--h:#6d6d6d;--shadow:0 1px 2px rgba(20,20,20,.05),0 4px 16px rgba(20,20,20,.04)}
@media (prefers-color-scheme:dark){:root{--bg:#14161a;--panel:#1c1f25;--ink:#e8e6e1;--soft:#a4adb8;--faint:#737d89;--line:#2d323a;--accent:#f0a35e;--accent-soft:#3a2a1b;
--a:#f0a35e;--b:#6fb0e8;--c:#86c673;--d:#c39ae0;--e:#e6c27a;--f:#8fb8c6;--g:#e58a9a;--h:#a5a5a5;--shadow:none}}
*{box-sizing:border-box}html{scroll-behavior:smooth;-webkit-text-size-adjust:100%}
body{margin:0;background:var(--bg);color:var(--ink);font:16px/1.55 system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}
.wrap{max-width:1180px;margin:0 auto;padding:0 28px}
code,pre{font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,'DejaVu Sans Mono',monospace;font-size:.86em}
header{padding:44px 0 26px}
.kind{margin:0;color:var(--soft);font-size:15px}.mark{color:var(--accent);font-weight:650;letter-spacing:.01em;margin-right:10px}
h1{font-size:36px;line-height:1.15;letter-spacing:-.02em;margin:6px 0 18px;font-weight:680;overflow-wrap:anywhere}
.facts{display:flex;flex-wrap:wrap;gap:8px 26px;margin:0 0 18px}.facts div{display:flex;gap:8px;align-items:baseline}
dt{color:var(--faint);font-size:13px}dd{margin:0}
.command{margin:0;padding:11px 15px;border:1px solid var(--line);border-radius:9px;background:var(--panel);color:var(--soft);overflow-x:auto;white-space:pre-wrap;overflow-wrap:anywhere}
nav{position:sticky;top:0;z-index:2;background:var(--bg);border-bottom:1px solid var(--line)}
nav .wrap{display:flex;gap:22px;overflow-x:auto}nav a{padding:11px 0;color:var(--soft);text-decoration:none;font-size:14px;white-space:nowrap}
nav a:hover{color:var(--accent)}
.stats{display:grid;grid-template-columns:repeat(auto-fit,minmax(165px,1fr));gap:14px;margin:28px 0 8px}
.stat{background:var(--panel);border:1px solid var(--line);border-radius:12px;padding:15px 17px;box-shadow:var(--shadow)}
.stat p{margin:0}.label{color:var(--soft);font-size:13px}.value{font-size:27px;font-weight:650;letter-spacing:-.015em;font-variant-numeric:tabular-nums;line-height:1.3}
.note{color:var(--faint);font-size:13px}
section{padding-top:34px;scroll-margin-top:30px}h2{font-size:22px;letter-spacing:-.01em;margin:0 0 6px;font-weight:650}
h3{font-size:15px;margin:0 0 10px;font-weight:600}.lead{color:var(--soft);margin:0 0 16px;max-width:76ch}
.panel{background:var(--panel);border:1px solid var(--line);border-radius:12px;padding:18px 20px;box-shadow:var(--shadow)}
.two{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,460px),1fr));gap:16px}
.scroll{overflow-x:auto;background:var(--panel);border:1px solid var(--line);border-radius:12px;box-shadow:var(--shadow)}
table{border-collapse:collapse;width:100%;font-size:14.5px}th{color:var(--soft);font-weight:550;font-size:13px;text-align:left;white-space:nowrap}
th,td{padding:8px 16px;border-bottom:1px solid var(--line);vertical-align:baseline}tbody tr:last-child td{border-bottom:0}
.num{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
tr.total td{font-weight:650}
svg{display:block;width:100%;height:auto}svg text{fill:var(--soft);font:12px system-ui,-apple-system,'Segoe UI',Roboto,Arial,sans-serif}
.view{margin:0 0 22px}.view h3{display:flex;flex-wrap:wrap;gap:4px 14px;align-items:baseline;margin-bottom:9px}.view h3 span{color:var(--soft);font-weight:400;font-variant-numeric:tabular-nums}
.triple{display:grid;grid-template-columns:repeat(3,minmax(0,1fr));gap:12px}.views{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,520px),1fr));gap:8px 28px}
figure{margin:0}figure img{display:block;width:100%;height:auto;border-radius:8px;background:var(--line)}.pixelated img{image-rendering:pixelated}
figcaption{color:var(--faint);font-size:12.5px;padding-top:5px}
.scale{display:flex;align-items:center;gap:12px;color:var(--soft);font-size:13px;margin:0 0 18px}.scale img{height:12px;width:240px;border-radius:3px;image-rendering:auto}
.legend{display:flex;flex-wrap:wrap;gap:4px 18px;font-size:13px;color:var(--soft);margin-top:10px}.legend i{display:inline-block;width:11px;height:11px;border-radius:3px;margin-right:7px;vertical-align:-1px}
details summary{cursor:pointer;color:var(--soft);font-size:14px;padding:4px 0 10px}
footer{color:var(--faint);font-size:13px;padding:44px 0 40px}
@media (max-width:640px){.wrap{padding:0 16px}h1{font-size:28px}.triple{gap:6px}}
@media print{nav{display:none}section{break-inside:avoid}}
";

//! The style sheet of every report.

/// Two palettes by preference; figures use the same custom properties as the text. Every colour of a text or a curve has a contrast of at
/// least 4.5 to every background (a test computes it).
pub(super) const CSS: &str = "
:root{--bg:#fbfaf8;--panel:#ffffff;--ink:#1d2126;--soft:#4f5864;--faint:#5f6974;--line:#e4e2dd;--accent:#9a4608;--accent-soft:#f9ecdf;
--a:#a44a06;--b:#2a66a0;--c:#37752a;--d:#7d4f9b;--e:#845a0c;--f:#456875;--g:#a2445a;--h:#626262;--good:#1b6e20;--bad:#b00020;
--shadow:0 1px 2px rgba(20,20,20,.05),0 4px 16px rgba(20,20,20,.04)}
@media (prefers-color-scheme:dark){:root{--bg:#14161a;--panel:#1c1f25;--ink:#e8e6e1;--soft:#b0b8c2;--faint:#98a1ac;--line:#2d323a;--accent:#f0a35e;--accent-soft:#3a2a1b;
--a:#f0a35e;--b:#6fb0e8;--c:#86c673;--d:#c39ae0;--e:#e6c27a;--f:#8fb8c6;--g:#e58a9a;--h:#a5a5a5;--good:#7fd087;--bad:#ff8a94;--shadow:none}}
*{box-sizing:border-box}html{scroll-behavior:smooth;-webkit-text-size-adjust:100%}
body{margin:0;background:var(--bg);color:var(--ink);font:16px/1.55 system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}
.wrap{max-width:1180px;margin:0 auto;padding:0 28px}
.skip{position:absolute;left:-9999px}.skip:focus{left:12px;top:12px;z-index:20;background:var(--panel);color:var(--ink);padding:8px 14px;border:2px solid var(--accent);border-radius:8px}
code,pre{font-family:ui-monospace,SFMono-Regular,Menlo,Consolas,'DejaVu Sans Mono',monospace;font-size:.86em}dd code{overflow-wrap:anywhere}
header{padding:44px 0 26px}
.kind{margin:0;color:var(--soft);font-size:15px}.mark{color:var(--accent);font-weight:650;letter-spacing:.01em;margin-right:10px}
h1{font-size:36px;line-height:1.15;letter-spacing:-.02em;margin:6px 0 18px;font-weight:680;overflow-wrap:anywhere}
.notice{margin:0 0 18px;padding:9px 15px;border-left:4px solid var(--accent);background:var(--accent-soft);border-radius:0 9px 9px 0;max-width:76ch}
.facts{display:flex;flex-wrap:wrap;gap:6px 26px;margin:0 0 14px}.facts div{display:flex;gap:8px;align-items:baseline}
dt{color:var(--faint);font-size:13px;white-space:nowrap}dd{margin:0}
.command{margin:0;padding:11px 15px;border:1px solid var(--line);border-radius:9px;background:var(--panel);color:var(--soft);white-space:pre-wrap;overflow-wrap:anywhere}
nav{position:sticky;top:0;z-index:2;background:var(--bg);border-bottom:1px solid var(--line)}
nav .wrap{display:flex;flex-wrap:wrap;gap:0 22px}nav a{padding:9px 0;color:var(--soft);text-decoration:none;font-size:14px;white-space:nowrap}
nav a:hover{color:var(--accent)}a{color:var(--accent)}:focus-visible{outline:2px solid var(--accent);outline-offset:2px}
.stats{display:grid;grid-template-columns:repeat(auto-fit,minmax(165px,1fr));gap:14px;margin:28px 0 8px}
.stat{background:var(--panel);border:1px solid var(--line);border-radius:12px;padding:15px 17px;box-shadow:var(--shadow)}
.stat p{margin:0}.label{color:var(--soft);font-size:13px}.value{font-size:27px;font-weight:650;letter-spacing:-.015em;font-variant-numeric:tabular-nums;line-height:1.3}
.note{color:var(--faint);font-size:13px}abbr[title]{text-decoration:underline dotted;text-underline-offset:3px;cursor:help}
section{padding-top:34px;scroll-margin-top:48px}h2{font-size:22px;letter-spacing:-.01em;margin:0 0 6px;font-weight:650}
h3{font-size:15px;margin:0 0 10px;font-weight:600}.lead{color:var(--soft);margin:0 0 16px;max-width:76ch}
.panel{background:var(--panel);border:1px solid var(--line);border-radius:12px;padding:18px 20px;box-shadow:var(--shadow)}
.stack{display:grid;gap:16px;align-content:start;grid-template-columns:minmax(0,1fr)}.two{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,460px),1fr));gap:16px}
.two.keep{grid-template-columns:repeat(auto-fill,minmax(min(100%,460px),1fr))}
.scroll{overflow-x:auto;background:var(--panel);border:1px solid var(--line);border-radius:12px;box-shadow:var(--shadow)}
table{border-collapse:collapse;width:100%;font-size:14.5px}th{color:var(--soft);font-weight:550;font-size:13px;text-align:left}thead th{vertical-align:bottom}
th,td{padding:8px 16px;border-bottom:1px solid var(--line);vertical-align:baseline;overflow-wrap:break-word}tbody tr:last-child>*{border-bottom:0}
.num{text-align:right;font-variant-numeric:tabular-nums}td.num{white-space:nowrap}.good{color:var(--good)}.bad{color:var(--bad)}
tr.total td,.strong{font-weight:650}.cards th,.cards td{padding:8px 10px}caption{text-align:left;padding:12px 16px 4px;font-weight:600;font-size:14.5px}
svg{display:block;width:100%;height:auto}svg text{fill:var(--soft);font:12px system-ui,-apple-system,'Segoe UI',Roboto,Arial,sans-serif}svg text.ink{fill:var(--ink)}
.group{margin-top:30px}.views{display:grid;gap:30px;grid-template-columns:minmax(0,1fr)}.view{margin:0;border:0;padding:0;min-width:0}
.view h3{display:flex;flex-wrap:wrap;gap:4px 14px;align-items:baseline;margin-bottom:9px;overflow-wrap:anywhere}.view h3 span{color:var(--soft);font-weight:400;font-variant-numeric:tabular-nums}
.view input{position:absolute;opacity:0;width:1px;height:1px}
.view input+label{display:inline-block;padding:2px 11px;margin:0 5px 9px 0;border:1px solid var(--line);border-radius:999px;font-size:13px;color:var(--soft);background:var(--panel);cursor:pointer}
.view input:checked+label{background:var(--accent-soft);color:var(--ink);border-color:var(--accent)}.view input:focus-visible+label{outline:2px solid var(--accent);outline-offset:2px}
.zoom:checked+label .open,.zoom:not(:checked)+label .shut{display:none}
.frames{display:grid;grid-template-columns:repeat(3,minmax(0,1fr));gap:12px}.frames label{display:block;cursor:zoom-in}.zoom:checked~.frames label{cursor:zoom-out}
.pick-photo:checked~.frames,.pick-render:checked~.frames,.pick-error:checked~.frames{grid-template-columns:minmax(0,760px)}
.pick-photo:checked~.frames figure:not(.photo),.pick-render:checked~.frames figure:not(.render),.pick-error:checked~.frames figure:not(.error){display:none}
.view:has(.zoom:checked){position:fixed;inset:0;z-index:9;overflow:auto;background:var(--bg);padding:18px 22px}
.zoom:checked~.frames{gap:16px;grid-template-columns:repeat(auto-fit,minmax(min(100%,520px),1fr))}.zoom:checked~.frames img{max-height:calc(100vh - 130px);object-fit:contain;object-position:left top;background:none}
.pick-photo:checked~.zoom:checked~.frames,.pick-render:checked~.zoom:checked~.frames,.pick-error:checked~.zoom:checked~.frames{grid-template-columns:minmax(0,1fr)}
figure{margin:0}figure img{display:block;width:100%;height:auto;border-radius:8px;background:var(--line)}
figcaption{color:var(--faint);font-size:13px;padding-top:5px}
.strip{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(200px,45%),1fr));gap:12px;margin:0 0 16px}.large .strip{grid-template-columns:repeat(auto-fill,minmax(min(240px,45%),1fr))}.cells img{image-rendering:pixelated}
.scale{display:flex;flex-wrap:wrap;align-items:center;gap:6px 12px;color:var(--soft);font-size:13px;margin:0 0 18px}.scale img{height:12px;width:240px;max-width:50vw;border-radius:3px}
.legend{display:flex;flex-wrap:wrap;gap:4px 18px;font-size:13px;color:var(--soft);margin-top:10px}.legend i{display:inline-block;width:11px;height:11px;border-radius:3px;margin-right:7px;vertical-align:-1px}
.bars{list-style:none;margin:0;padding:0;font-size:13px;color:var(--soft)}.bars li{display:grid;grid-template-columns:minmax(60px,130px) minmax(0,1fr) 62px;gap:10px;align-items:center;padding:3px 0}
.bars .name{text-align:right;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}.bars .track{position:relative;height:16px}.bars .track i{display:block;height:100%;border-radius:3px}
.bars .track b{position:absolute;top:-4px;bottom:-4px;border-left:1.5px dashed var(--faint)}.bars .value{font:inherit;letter-spacing:0;text-align:right;font-variant-numeric:tabular-nums}
.parts{display:flex;gap:2px;height:30px}.parts i{display:block;border-radius:3px;min-width:1px}
.grid-table{table-layout:fixed;font-size:13px}.grid-table th,.grid-table td{padding:5px 4px;border:0;text-align:center;vertical-align:middle}.grid-table th:first-child{width:104px;text-align:left;padding-left:14px;overflow-wrap:break-word}
.grid-table img{display:block;width:100%;height:auto;border-radius:6px}.grid-table small{display:block;color:var(--faint);font-size:12px;font-variant-numeric:tabular-nums}.grid-table .mid{background:var(--accent-soft)}.grid-table .mid small{color:var(--ink)}
.hints{margin:0;padding-left:20px;max-width:82ch}.hints li{margin:0 0 8px}.glossary{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:8px 22px;max-width:96ch;margin:0}.glossary dt{color:var(--ink);font-weight:600;font-size:14px}.glossary dd{color:var(--soft);font-size:14px}
.stages{list-style:none;margin:0 0 14px;padding:0;display:flex;flex-wrap:wrap;gap:10px}.stages li{border:1px solid var(--line);border-left:5px solid var(--faint);border-radius:9px;background:var(--panel);padding:8px 13px;font-size:13.5px;color:var(--soft)}
.stages li b{display:block;color:var(--ink);font-weight:600}.stages .ok{border-left-color:var(--good)}.stages .first,.stages .after{border-left-color:var(--bad)}.stages .first{outline:2px solid var(--bad)}
details summary{cursor:pointer;color:var(--soft);font-size:14px;padding:10px 0}
footer{color:var(--faint);font-size:13px;padding:44px 0 40px}
@media (max-width:640px){.wrap{padding:0 16px}nav .wrap{flex-wrap:nowrap;overflow-x:auto}h1{font-size:28px}header{padding-top:26px}.panel{padding:14px 12px}th,td{padding:7px 6px}table{font-size:13px}th{font-size:12px}
td:first-child,th:first-child{padding-left:12px}td:last-child,th:last-child{padding-right:12px}td:first-child,td:first-child dd code{overflow-wrap:anywhere}
svg text{font-size:17px}.stats{grid-template-columns:repeat(2,minmax(0,1fr));gap:10px}.stat{padding:11px 12px}.value{font-size:22px}
.frames{grid-template-columns:repeat(2,minmax(0,1fr));gap:8px}.frames .render{grid-column:1/3;grid-row:1}.pick-photo:checked~.frames,.pick-render:checked~.frames,.pick-error:checked~.frames{grid-template-columns:minmax(0,1fr)}
.pick-photo:checked~.frames figure,.pick-error:checked~.frames figure,.zoom:checked~.frames figure{grid-column:1;grid-row:auto}.glossary{grid-template-columns:minmax(0,1fr);gap:2px}.glossary dd{margin-bottom:10px}
.cards thead{display:none}.cards tr{display:block;padding:8px 12px;border-bottom:1px solid var(--line)}.cards td{display:flex;justify-content:space-between;gap:16px;border:0;padding:2px 0!important;text-align:right}.cards td::before{content:attr(data-label);color:var(--soft);text-align:left}
.grid-table{min-width:640px}.grid-table th:first-child{position:sticky;left:0;background:var(--panel);width:84px;z-index:1}}
@media (prefers-reduced-motion:reduce){html{scroll-behavior:auto}}
@media print{nav,.view input+label{display:none}section{break-inside:avoid}}
";

#[cfg(test)]
mod tests {
    use super::CSS;
    use std::collections::BTreeMap;

    /// Relative luminance of `#rrggbb` (WCAG 2.1).
    fn luminance(hex: &str) -> f64 {
        let channel = |at: usize| {
            let c = f64::from(u8::from_str_radix(&hex[at..at + 2], 16).expect("a colour as #rrggbb")) / 255.0;
            if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }
        };
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    }

    fn contrast(a: &str, b: &str) -> f64 {
        let (a, b) = (luminance(a), luminance(b));
        if a > b { (a + 0.05) / (b + 0.05) } else { (b + 0.05) / (a + 0.05) }
    }

    /// The custom properties of the light and of the dark palette that are colours.
    fn palettes() -> [BTreeMap<&'static str, &'static str>; 2] {
        let mut blocks = CSS.split(":root{").skip(1).map(|rest| {
            let block = rest.split('}').next().expect("a block");
            let entries =
                block.split(';').filter_map(|entry| entry.trim().strip_prefix("--")?.split_once(':'));
            entries.filter(|(_, value)| value.starts_with('#')).collect()
        });
        [blocks.next().expect("a light palette"), blocks.next().expect("a dark palette")]
    }

    #[test]
    fn every_colour_of_text_and_curves_has_a_contrast_of_4_5() {
        assert!((contrast("#ffffff", "#000000") - 21.0).abs() < 1e-9, "the definition");
        for (name, palette) in ["light", "dark"].into_iter().zip(palettes()) {
            let backgrounds = ["bg", "panel", "accent-soft"];
            let quiet = ["line"]; // decoration: lines of tables
            let colours: Vec<_> =
                palette.iter().filter(|(k, _)| !backgrounds.contains(k) && !quiet.contains(k)).collect();
            assert_eq!(colours.len(), 14, "{name}: four of text, eight of curves, good and bad: {palette:?}");
            for (colour, value) in colours {
                for background in backgrounds {
                    let ratio = contrast(value, palette[background]);
                    assert!(ratio >= 4.5, "{name}: --{colour} on --{background} is {ratio:.2}:1");
                }
            }
        }
    }

    /// Selector and declarations of every rule, also of those for narrow screens.
    fn rules() -> Vec<(&'static str, Vec<(&'static str, &'static str)>)> {
        let mut out = Vec::new();
        for part in CSS.split('}') {
            let Some((selector, body)) = part.rsplit_once('{') else { continue };
            let selector = selector.rsplit('{').next().unwrap_or(selector).trim();
            out.push((selector, body.split(';').filter_map(|d| d.trim().split_once(':')).collect()));
        }
        out
    }

    #[test]
    fn nothing_is_wider_than_a_telephone() {
        /// Width of the content of a page 390 pixels wide.
        const CONTENT: f64 = 390.0 - 2.0 * 16.0;
        let rules = rules();
        assert!(rules.len() > 60, "{} rules", rules.len());
        let all = |name: &str, property: &str| -> Vec<&str> {
            let own = rules.iter().filter(|(selector, _)| selector.split(',').any(|s| s.trim() == name));
            own.flat_map(|(_, d)| d).filter(|(p, _)| *p == property).map(|(_, value)| *value).collect()
        };
        // What may be wider scrolls in its own box.
        assert_eq!(all(".scroll", "overflow-x"), ["auto"], "tables");
        assert!(all("nav .wrap", "overflow-x").contains(&"auto"), "the navigation");
        assert_eq!(all(".command", "overflow-wrap"), ["anywhere"], "the command line is broken anywhere");
        let in_scroll = [".grid-table"];
        for (selector, declarations) in &rules {
            let has = |property: &str| declarations.iter().any(|(p, _)| *p == property);
            for (property, value) in declarations {
                let widths: Vec<f64> = value
                    .split(|c: char| !(c.is_ascii_alphanumeric() || c == '.'))
                    .filter_map(|word| word.strip_suffix("px")?.parse().ok())
                    .collect();
                let widest = widths.iter().copied().fold(0.0, crate::num::order::max);
                let fits = match *property {
                    "width" => has("max-width") || widest <= CONTENT,
                    "min-width" => widest <= CONTENT || in_scroll.contains(selector),
                    "grid-template-columns" => {
                        let total = widths.iter().fold(0.0, |sum, width| sum + width);
                        value.contains("min(100%") || value.contains("minmax(0,") || total <= CONTENT
                    }
                    _ => true,
                };
                assert!(fits, "{selector}{{{property}:{value}}} is wider than {CONTENT} pixels");
            }
        }
        for (name, property, value) in [("svg", "width", "100%"), ("figure img", "width", "100%")] {
            assert!(all(name, property).contains(&value), "{name}: {property}");
        }
    }

    #[test]
    fn every_colour_that_is_used_is_defined_in_both_palettes() {
        for palette in palettes() {
            for used in CSS.split("var(--").skip(1).map(|rest| rest.split(')').next().expect("closed")) {
                assert!(used == "shadow" || palette.contains_key(used), "--{used}");
            }
        }
    }
}

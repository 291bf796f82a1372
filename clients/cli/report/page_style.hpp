// Style sheet of the report's page. One column on a phone and on paper, two on wide screens.
#pragma once

namespace bregma::cli::report {

inline constexpr const char *kPageStyle = R"css(
:root{color-scheme:light;--ink:#1c2430;--soft:#5b6472;--line:#e1e5eb;--paper:#fff;--ground:#f5f6f8;--good:#1b7a50;--bad:#b3261e}
*{box-sizing:border-box}
body{margin:0;background:var(--ground);color:var(--ink);font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif;-webkit-text-size-adjust:100%}
main{max-width:1140px;margin:0 auto;padding:28px 20px 48px}
header{display:flex;flex-wrap:wrap;align-items:center;gap:8px 20px;margin-bottom:18px}
h1{font-size:1.75rem;line-height:1.2;margin:0;letter-spacing:-.01em}
h2{font-size:1.15rem;margin:0 0 12px}
h3{font-size:1rem;margin:18px 0 8px}
.sub{color:var(--soft);flex-basis:100%;margin:0}
.badge{border-radius:99px;padding:3px 14px;font-weight:600;font-size:.95rem;background:#e8ebf0;color:var(--soft)}
.badge.good{background:#dff3e8;color:var(--good)}.badge.bad{background:#fbe3e1;color:var(--bad)}
section{background:var(--paper);border:1px solid var(--line);border-radius:10px;padding:20px 22px;margin:0 0 18px}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(245px,1fr));gap:12px;margin-bottom:18px}
.card{background:var(--paper);border:1px solid var(--line);border-radius:10px;padding:13px 16px}
.card b{display:block;font-size:1.5rem;line-height:1.25;font-variant-numeric:tabular-nums;letter-spacing:-.01em}
.card span{display:block;font-size:.85rem;font-weight:600}.card small{display:block;color:var(--soft);font-size:.82rem;line-height:1.35}
.columns{display:grid;grid-template-columns:1fr 1fr;gap:18px}.columns>section{margin:0}.columns{margin-bottom:18px}
.columns>section:only-child{grid-column:1/-1}
.pair{display:grid;grid-template-columns:1fr 1fr;gap:18px;margin-top:12px}.pair>figure+figure{margin-top:0}.pair>figure:only-child{grid-column:1/-1}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.92rem;font-variant-numeric:tabular-nums}
th{text-align:left;color:var(--soft);font-weight:600;font-size:.82rem;border-bottom:1px solid #cfd5dd;padding:5px 14px 5px 0;white-space:nowrap}
td{border-bottom:1px solid var(--line);padding:6px 14px 6px 0;vertical-align:top}
th.n,td.n{text-align:right}tr:last-child td{border-bottom:0}
.yes{color:var(--good);font-weight:600}.no{color:var(--bad);font-weight:600}
p{margin:0 0 10px}.note{color:var(--soft);font-size:.9rem;margin-top:10px}
figure{margin:0}figure+figure{margin-top:22px}figcaption{color:var(--soft);font-size:.88rem;margin-top:8px;max-width:75ch}
svg{display:block;width:100%;height:auto;font-family:inherit}
svg .halo{paint-order:stroke;stroke:#fff;stroke-width:3px}
.narrow{display:none}
.heads{display:grid;grid-template-columns:repeat(4,1fr);gap:6px}
.heads img{display:block;width:100%;height:auto}.heads p{text-align:center;color:var(--soft);font-size:.85rem;margin:2px 0 6px}
.bar{max-width:430px;margin:4px auto 0}
footer{color:var(--soft);font-size:.85rem}
@media(max-width:760px){main{padding:18px 12px 32px}section{padding:15px 14px}.columns,.pair{grid-template-columns:1fr}
.heads{grid-template-columns:1fr 1fr}.wide{display:none}.narrow{display:block}h1{font-size:1.45rem}
.cards{grid-template-columns:1fr 1fr;gap:8px}.card{padding:10px 12px}.card b{font-size:1.25rem}}
@media print{*{-webkit-print-color-adjust:exact;print-color-adjust:exact}body{background:#fff;font-size:9.5pt;line-height:1.35}main{max-width:none;padding:0}
section,.card{border-color:#ccc;border-radius:4px}section{padding:8px 10px;margin:0 0 8px;break-inside:auto}.card{padding:6px 9px;break-inside:avoid}
h1{font-size:15pt}h2{font-size:11.5pt;margin:0 0 5px}h2,h3{break-after:avoid}h3{margin:8px 0 4px;font-size:9.5pt}
.cards{grid-template-columns:repeat(4,1fr);gap:6px;margin-bottom:8px}.card b{font-size:12.5pt}
.columns,.pair{grid-template-columns:1fr 1fr;gap:8px;margin:0 0 8px}.scroll{overflow:visible}
table{font-size:8pt}th{white-space:normal;font-size:7.5pt}th,td{padding:2px 7px 2px 0;min-width:7em;overflow-wrap:anywhere}
th.n,td.n{min-width:0;overflow-wrap:normal}td.n{white-space:nowrap}thead{display:table-header-group}tr,figure,.heads{break-inside:avoid}
.columns th,.columns td{min-width:5.2em}.columns th.n,.columns td.n{min-width:0}
.heads{grid-template-columns:repeat(4,1fr)}.heads p,figcaption,.note,.sub,footer,.card small,.card span{font-size:8pt}figcaption{margin-top:3px}
figure+figure{margin-top:8px}svg{max-height:56mm}.wide{display:block}.narrow{display:none}@page{size:A4;margin:12mm}}
)css";

} // namespace bregma::cli::report

//! The HTML report of a demo: one file with pictures, nothing loaded from elsewhere.

mod frame_picture;
mod plans;
mod timeline;
mod top_view;

use std::fmt::Write as _;

use arthro_proto::gateway::v1::GetReportResponse;
use arthro_simulator::scenario::Scenario;

use crate::demo::Summary;
use crate::scene::Scene;

const STYLE: &str = "
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1d2430; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
table { border-collapse: collapse; } td, th { padding: .25rem .9rem .25rem 0; text-align: left; border-bottom: 1px solid #e3e6ea; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
.missed { color: #b3261e; font-weight: 600; } .kept { color: #1b7f4b; }
figure { margin: 1rem 0; } figcaption { color: #5b6472; font-size: .9rem; } svg, img { max-width: 100%; height: auto; }
";

/// The whole report as one HTML page.
pub fn html(
    scenario: &Scenario,
    frame: &Scene,
    summary: &Summary,
    journal: &GetReportResponse,
) -> String {
    let mut page = String::from(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>arthro: simulated meniscoplasty</title>",
    );
    // Writing into a String cannot fail.
    write!(page, "<style>{STYLE}</style></head><body>").ok();
    write!(
        page,
        "<h1>Simulated meniscoplasty</h1><p>{} bites in {:.0} s of robot time. Everything under \
         “referee” is what truly happened in the simulated cell, not what the services believe.</p>",
        summary.procedure.bites_done, summary.procedure.robot_seconds
    )
    .ok();
    page.push_str("<h2>Limits</h2>");
    page.push_str(&checks(summary));
    page.push_str("<h2>Plan and bites</h2>");
    page.push_str(&plans::rows(summary));
    page.push_str(&top_view::figure(scenario, summary, journal));
    page.push_str("<h2>What each bite does</h2>");
    page.push_str(&plans::accounts(&summary.evaluation));
    page.push_str("<h2>What was truly removed</h2>");
    page.push_str(&plans::truth(summary));
    page.push_str("<h2>What the camera saw</h2>");
    page.push_str(&frame_picture::figure(frame));
    page.push_str("<h2>Where the time went</h2>");
    page.push_str(&timeline::figure(journal));
    page.push_str("<h2>All figures</h2>");
    page.push_str(&figures(summary));
    page.push_str("</body></html>\n");
    page
}

fn checks(summary: &Summary) -> String {
    let mut table =
        String::from("<table><tr><th>referee</th><th>measured</th><th>limit</th><th></th></tr>");
    for check in summary.checks() {
        let (class, word) = if check.kept {
            ("kept", "kept")
        } else {
            ("missed", "MISSED")
        };
        write!(
            table,
            "<tr><td>{}</td><td class=\"number\">{}</td><td>{}</td><td class=\"{class}\">{word}</td></tr>",
            check.what,
            escape(&check.value),
            escape(&check.limit)
        )
        .ok();
    }
    table.push_str("</table>");
    table
}

fn figures(summary: &Summary) -> String {
    let value = summary.json();
    let mut table = String::from("<table>");
    for (group, fields) in value.as_object().into_iter().flatten() {
        let Some(fields) = fields.as_object() else {
            continue;
        };
        for (name, field) in fields.iter().filter(|(_, field)| !field.is_object()) {
            let text = match field.as_f64() {
                Some(number) if field.is_f64() => format!("{number:.4}"),
                _ => field.to_string(),
            };
            write!(
                table,
                "<tr><td>{group}</td><td>{name}</td><td class=\"number\">{}</td></tr>",
                escape(&text)
            )
            .ok();
        }
    }
    table.push_str("</table>");
    table
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

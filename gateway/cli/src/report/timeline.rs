//! How long each step of each bite took on the controllers' clock.

use std::fmt::Write as _;

use arthro_proto::gateway::v1::{GetReportResponse, Step, StepKind};

/// Colours of the view and of steps (a) to (h).
const COLORS: [(StepKind, &str, &str); 9] = [
    (StepKind::View, "view", "#b7b7b7"),
    (StepKind::Approach, "approach", "#9db4d6"),
    (StepKind::Pivot, "pivot", "#5f87c2"),
    (StepKind::Insert, "insert", "#2a62c9"),
    (StepKind::Bite, "bite", "#d9544d"),
    (StepKind::Retract, "retract", "#2f9e6e"),
    (StepKind::PivotBack, "pivot back", "#7cc4a4"),
    (StepKind::ToTray, "to tray", "#c9b27a"),
    (StepKind::Release, "release", "#8d6ca8"),
];
const BAR_HEIGHT: f64 = 14.0;
const WIDTH: f64 = 900.0;

/// The picture with its caption.
pub fn figure(journal: &GetReportResponse) -> String {
    let bites = journal
        .steps
        .iter()
        .map(|step| step.bite)
        .max()
        .unwrap_or(-1);
    if bites < 0 {
        return "<p>No bite was made.</p>".to_owned();
    }
    let rows: Vec<Vec<&Step>> = (0..=bites)
        .map(|bite| {
            journal
                .steps
                .iter()
                .filter(|step| step.bite == bite)
                .collect()
        })
        .collect();
    let longest = rows
        .iter()
        .map(|row| row.iter().map(|step| seconds(step)).sum::<f64>())
        .fold(1.0, f64::max);
    let height = rows.len() as f64 * BAR_HEIGHT + 30.0;
    let mut svg = format!(
        "<figure><svg viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" role=\"img\" aria-label=\"durations\">"
    );
    for (index, row) in rows.iter().enumerate() {
        let y = index as f64 * BAR_HEIGHT;
        let mut x = 30.0;
        write!(
            svg,
            "<text x=\"0\" y=\"{:.0}\" font-size=\"10\">{}</text>",
            y + 10.0,
            index + 1
        )
        .ok();
        for step in row {
            let width = seconds(step) / longest * (WIDTH - 60.0);
            let color = COLORS
                .iter()
                .find(|(kind, ..)| *kind == step.kind())
                .map_or("#bbb", |(_, _, color)| color);
            write!(
                svg,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{:.1}\" fill=\"{color}\"/>",
                BAR_HEIGHT - 2.0
            )
            .ok();
            x += width;
        }
    }
    let mut x = 30.0;
    for (_, name, color) in COLORS {
        let y = height - 16.0;
        write!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"10\" height=\"10\" fill=\"{color}\"/><text x=\"{}\" y=\"{}\" font-size=\"11\">{name}</text>",
            x + 14.0,
            y + 9.0
        )
        .ok();
        x += 95.0;
    }
    write!(
        svg,
        "</svg><figcaption>Steps (a) to (h) of each bite; the longest cycle took {longest:.1} s of robot time.</figcaption></figure>"
    )
    .ok();
    svg
}

fn seconds(step: &Step) -> f64 {
    (step.ended_controller_s - step.started_controller_s).max(0.0)
}

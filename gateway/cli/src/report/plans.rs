//! The plan beside the paper's bites on the same contour, what each planned bite does, and what came of it.

use std::fmt::Write as _;

use arthro_proto::planning::v1::ResectionEvaluation;

use crate::demo::Summary;

/// The plan and the paper's list, a row each.
pub fn rows(summary: &Summary) -> String {
    let mut table = String::from(
        "<table><tr><th>on the same contour</th><th>bites</th><th>predicted</th><th>region</th><th>lesion</th>\
         <th>outside</th><th>narrowest rim</th><th>scallop rms</th><th>in this order</th></tr>",
    );
    row(&mut table, "plan", &summary.evaluation);
    row(&mut table, "paper", &summary.paper);
    table.push_str("</table>");
    table
}

fn row(table: &mut String, who: &str, evaluation: &ResectionEvaluation) {
    let blocked = evaluation.infeasible_bites.len();
    let order = match blocked {
        0 => "feasible".to_owned(),
        count => format!("{count} blocked"),
    };
    let scallop = evaluation
        .scallop_rms_mm
        .map_or_else(|| "-".to_owned(), |rms_mm| format!("{rms_mm:.2} mm"));
    let cells = [
        evaluation.bites.to_string(),
        format!("{:.1} min", evaluation.predicted_seconds / 60.0),
        format!("{:.1} %", evaluation.region_covered_percent),
        format!("{:.1} %", evaluation.lesion_covered_percent),
        format!("{:.1} mm3", evaluation.outside_removed_mm3),
        format!("{:.1} mm", evaluation.rim_min_mm),
        scallop,
        order,
    ];
    push_row(table, who, &cells);
}

/// What of the tissue was planned and what truly happened.
pub fn truth(summary: &Summary) -> String {
    let mut table = String::from("<table><tr><th>referee</th><th>planned</th><th>truly</th></tr>");
    for (what, planned, truly, unit) in summary.tissue() {
        let cells = [format!("{planned:.1} {unit}"), format!("{truly:.1} {unit}")];
        push_row(&mut table, what, &cells);
    }
    table.push_str("</table>");
    table
}

/// What each bite of the plan does at its time.
pub fn accounts(evaluation: &ResectionEvaluation) -> String {
    let mut table = String::from(
        "<table><tr><th>bite</th><th>new tissue</th><th>outside the region</th><th>throat blocked</th>\
         <th>predicted time</th></tr>",
    );
    for (order, account) in evaluation.accounts.iter().enumerate() {
        let cells = [
            format!("{:.1} mm3", account.region_mm3 + account.outside_mm3),
            format!("{:.1} mm3", account.outside_mm3),
            format!("{:.0} %", account.throat_blocked_percent),
            format!("{:.1} s", account.seconds),
        ];
        push_row(&mut table, &(order + 1).to_string(), &cells);
    }
    table.push_str("</table>");
    table
}

fn push_row(table: &mut String, name: &str, cells: &[String]) {
    // Writing into a String cannot fail.
    write!(table, "<tr><td>{name}</td>").ok();
    for cell in cells {
        write!(table, "<td class=\"number\">{cell}</td>").ok();
    }
    table.push_str("</tr>");
}

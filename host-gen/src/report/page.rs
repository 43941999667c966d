//! The page: one HTML file with everything in it.

use super::Review;

const TEMPLATE: &str = include_str!("web/page.html");
const STYLE: &str = include_str!("web/page.css");
const SCRIPT: &str = include_str!("web/page.js");
const SCENE: &str = include_str!("web/scene.js");
const PLOTLY: &str = include_str!("web/vendor/plotly-basic.min.js");
const THREE: &str = include_str!("web/vendor/three.min.js");

/// The page of a review. It loads nothing from a network.
pub fn page(review: &Review) -> String {
    page_of(&review.json())
}

/// The page of a review that is given as JSON.
pub fn page_of(json: &str) -> String {
    // Inside a script element `</script` ends it, and after `<!--<script` that does not. In JSON
    // `<` is only in strings.
    let data = json.replace('<', "\\u003c");
    let parts = [
        ("{{style}}", STYLE),
        ("{{plotly}}", PLOTLY),
        ("{{three}}", THREE),
        ("{{data}}", data.as_str()),
        ("{{scene}}", SCENE),
        ("{{script}}", SCRIPT),
    ];
    fill(TEMPLATE, &parts)
}

/// `template` with its placeholders replaced, in their order; the replacements are not
/// searched for placeholders.
fn fill(template: &str, parts: &[(&str, &str)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    for (place, text) in parts {
        let (before, after) = rest
            .split_once(place)
            .expect("the template has every placeholder once, in this order");
        page.push_str(before);
        page.push_str(text);
        rest = after;
    }
    page + rest
}

#[cfg(test)]
mod tests {
    use super::{SCENE, SCRIPT, THREE};

    /// The bundle of three.js has only what its entry names: all that the page uses must be
    /// among it, the version too.
    #[test]
    fn the_bundle_has_what_the_page_uses() {
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let uses = [SCRIPT, SCENE].into_iter().flat_map(|text| {
            let after = text.split("THREE.").skip(1);
            after.map(move |rest| rest.split(|c| !is_name(c)).next().unwrap_or(rest))
        });
        let mut count = 0;
        for name in uses {
            let exported = [format!("{{{name}:()=>"), format!(",{name}:()=>")];
            assert!(exported.iter().any(|text| THREE.contains(text)), "{name}");
            count += 1;
        }
        assert!(count > 20);
    }
}

//! Names that do not exist, and those that were probably meant.

use super::error::EntryError;

/// The index of `name` among the `known` ones; otherwise what [`missing`] says.
pub(super) fn find<'a>(
    entry: impl Into<String>,
    what: &str,
    name: &str,
    known: impl Iterator<Item = &'a str> + Clone,
    fix: &str,
) -> Result<usize, EntryError> {
    let found = known.clone().position(|known| known == name);
    found.ok_or_else(|| missing(entry, what, name, known, fix))
}

/// That `name` at `entry` is none of the `known` ones: which of them it resembles, and `fix`.
/// `what` says of what kind they are.
pub(super) fn missing<'a>(
    entry: impl Into<String>,
    what: &str,
    name: &str,
    known: impl IntoIterator<Item = &'a str>,
    fix: &str,
) -> EntryError {
    let error = EntryError::new(entry, format!("{what} \"{name}\" does not exist"));
    match nearest(name, known) {
        Some(near) => error.fix(format!("did you mean \"{near}\"? Otherwise {fix}")),
        None => error.fix(fix),
    }
}

/// The one of the `known` names that `name` is a slip of: one letter, and one more for every three
/// that it has.
pub(super) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = name.to_lowercase();
    let slips = |known: &str| strsim::damerau_levenshtein(&lower, &known.to_lowercase());
    let near = known.into_iter().min_by_key(|known| slips(known))?;
    (slips(near) <= 1 + near.chars().count() / 3).then_some(near)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_found_and_other_names_are_not() {
        let known = ["leg1", "leg6", "block5", "mass", "cog"];
        for (name, near) in [
            ("leg7", Some("leg1")),
            ("Leg6", Some("leg6")),
            ("lge6", Some("leg6")),
            ("blok5", Some("block5")),
            ("mas", Some("mass")),
            ("sensitivity", None),
            ("", None),
        ] {
            assert_eq!(nearest(name, known), near, "{name}");
        }
        assert_eq!(nearest("leg1", []), None);
    }
}

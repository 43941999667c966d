//! Names that other programs accept for signals.

use std::collections::HashSet;

/// The longest name that MATLAB accepts (`namelengthmax`).
const LONGEST: usize = 63;

/// One identifier for each pair of a role and a name, in their order: `role_name`, with an
/// underscore for everything in the name but ASCII letters, digits and underscores, at most 63 bytes
/// long.
///
/// All are different: what would be there already gets `_2`, `_3` and so on at its end. With a role
/// that is an ASCII word, MATLAB, Octave and python-control accept them as names of signals and of
/// variables.
pub fn identifiers<'a>(names: impl IntoIterator<Item = (&'a str, &'a str)>) -> Vec<String> {
    let mut taken = HashSet::new();
    let unique = |(role, name): (&str, &str)| {
        let legal = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let whole: String = format!("{role}_{name}").chars().map(legal).collect();
        let numbered = (1..).map(|n| {
            let end = if n == 1 {
                String::new()
            } else {
                format!("_{n}")
            };
            let kept = whole.len().min(LONGEST - end.len());
            format!("{}{end}", &whole[..kept])
        });
        let free = numbered.into_iter().find(|name| !taken.contains(name));
        let free = free.unwrap_or_default();
        taken.insert(free.clone());
        free
    };
    names.into_iter().map(unique).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_legal_and_unique() {
        let long = "x".repeat(70);
        let names = [
            ("performance", "block15.e1"),
            ("performance", "block15_e1"),
            ("performance", "block15 e1"),
            ("force", "Füße"),
            ("sensor", &long),
            ("sensor", &long),
        ];
        let found = identifiers(names);
        assert_eq!(
            found[..4],
            [
                "performance_block15_e1",
                "performance_block15_e1_2",
                "performance_block15_e1_3",
                "force_F__e"
            ]
        );
        assert_eq!(found[4], format!("sensor_{}", "x".repeat(56)));
        assert_eq!(found[5], format!("sensor_{}_2", "x".repeat(54)));
    }
}

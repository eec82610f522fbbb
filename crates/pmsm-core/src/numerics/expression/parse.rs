//! From characters to nodes, by recursive descent of bounded depth.

use super::{DEEPEST, Expression, Fault, Function, Kind, LONGEST, Node};

/// Names that a message lists at most.
const MOST_LISTED: usize = 20;

/// The formula that a text is, over quantities of these names. `pi` is a number.
///
/// # Errors
/// What is wrong with it, and where: an unknown name with the nearest known one, a bracket that is open, a text that is too long or too deeply
/// nested.
pub fn parse(text: &str, names: &[&str]) -> Result<Expression, Fault> {
    let signs: Vec<char> = text.chars().take(LONGEST + 1).collect();
    if signs.len() > LONGEST {
        return Err(Fault {
            at: LONGEST + 1,
            problem: format!("it has more than {LONGEST} characters"),
            fix: "split it into several effects".into(),
        });
    }
    if let Some(at) = signs.iter().position(|c| !c.is_ascii() || c.is_ascii_control() && !c.is_whitespace()) {
        return Err(Fault {
            at: at + 1,
            problem: format!("'{}' is no character of a formula", signs[at].escape_default()),
            fix: "write names such as omega_m in plain letters, products with * and powers with **".into(),
        });
    }
    let mut parser = Parser { signs: &signs, names, at: 0, depth: 0, nodes: Vec::new() };
    let _ = parser.sum()?;
    match parser.next() {
        None => Ok(Expression { nodes: parser.nodes }),
        Some(')') => Err(parser.fault("this bracket was not opened", "remove it, or open it")),
        Some(c) => {
            Err(parser
                .fault(&format!("'{c}' does not go on from here"), "put an operator between, such as *"))
        }
    }
}

struct Parser<'a> {
    signs: &'a [char],
    names: &'a [&'a str],
    at: usize,
    depth: usize,
    nodes: Vec<Node>,
}

impl Parser<'_> {
    fn fault(&self, problem: &str, fix: &str) -> Fault {
        Fault { at: self.at + 1, problem: problem.into(), fix: fix.into() }
    }

    /// The next character that is no space; none at the end.
    fn next(&mut self) -> Option<char> {
        while self.signs.get(self.at).is_some_and(|c| c.is_whitespace()) {
            self.at += 1;
        }
        self.signs.get(self.at).copied()
    }

    /// Whether the next characters are these, which are then passed.
    fn takes(&mut self, wanted: &str) -> bool {
        let _ = self.next();
        let found = wanted.chars().enumerate().all(|(k, c)| self.signs.get(self.at + k) == Some(&c));
        self.at += if found { wanted.len() } else { 0 };
        found
    }

    fn put(&mut self, kind: Kind, at: usize) -> usize {
        self.nodes.push(Node { kind, at: at + 1 });
        self.nodes.len() - 1
    }

    /// One level further down.
    fn deeper(&mut self, inner: fn(&mut Self) -> Result<usize, Fault>) -> Result<usize, Fault> {
        if self.depth == DEEPEST {
            return Err(self.fault(
                &format!("brackets, signs and powers stand in one another more than {DEEPEST} deep"),
                "write it with fewer brackets",
            ));
        }
        self.depth += 1;
        let found = inner(self);
        self.depth -= 1;
        found
    }

    fn sum(&mut self) -> Result<usize, Fault> {
        let mut left = self.product()?;
        loop {
            let sign = self.next();
            let at = self.at;
            let kind: fn(usize, usize) -> Kind = match sign {
                Some('+') => Kind::Add,
                Some('-') => Kind::Sub,
                _ => return Ok(left),
            };
            self.at += 1;
            let right = self.product()?;
            left = self.put(kind(left, right), at);
        }
    }

    fn product(&mut self) -> Result<usize, Fault> {
        let mut left = self.deeper(Self::signed)?;
        loop {
            let sign = self.next();
            let at = self.at;
            let kind: fn(usize, usize) -> Kind = match sign {
                Some('*') => Kind::Mul,
                Some('/') => Kind::Div,
                _ => return Ok(left),
            };
            self.at += 1;
            let right = self.deeper(Self::signed)?;
            left = self.put(kind(left, right), at);
        }
    }

    fn signed(&mut self) -> Result<usize, Fault> {
        let sign = self.next();
        let at = self.at;
        match sign {
            Some('-') => {
                self.at += 1;
                let inner = self.deeper(Self::signed)?;
                Ok(self.put(Kind::Neg(inner), at))
            }
            Some('+') => {
                self.at += 1;
                self.deeper(Self::signed)
            }
            _ => self.power(),
        }
    }

    fn power(&mut self) -> Result<usize, Fault> {
        let base = self.atom()?;
        let _ = self.next();
        let at = self.at;
        if !(self.takes("**") || self.takes("^")) {
            return Ok(base);
        }
        let exponent = self.deeper(Self::signed)?;
        Ok(self.put(Kind::Pow(base, exponent), at))
    }

    fn atom(&mut self) -> Result<usize, Fault> {
        let at = match self.next() {
            None => return Err(self.fault("the formula ends here", "complete it")),
            Some(_) => self.at,
        };
        match self.signs[at] {
            '(' => {
                self.at += 1;
                let inner = self.deeper(Self::sum)?;
                self.closed(at)?;
                Ok(inner)
            }
            c if c.is_ascii_digit() || c == '.' => self.number(),
            c if c.is_ascii_alphabetic() || c == '_' => self.name(),
            c => Err(self.fault(
                &format!("'{c}' stands where a value is expected"),
                "give a number, a name or a bracket",
            )),
        }
    }

    /// Passes the bracket that closes the one at a place.
    fn closed(&mut self, open: usize) -> Result<(), Fault> {
        if self.takes(")") {
            return Ok(());
        }
        let problem = match self.next() {
            None => "the bracket that opens here is not closed".to_string(),
            Some(c) => format!("'{c}' follows before the bracket that opens here is closed"),
        };
        Err(Fault { at: open + 1, problem, fix: "close it with ), or put an operator between".into() })
    }

    fn number(&mut self) -> Result<usize, Fault> {
        let begin = self.at;
        let digits = |at: &mut usize| {
            while self.signs.get(*at).is_some_and(|c| c.is_ascii_digit() || *c == '.') {
                *at += 1;
            }
        };
        let mut at = begin;
        digits(&mut at);
        if self.signs.get(at).is_some_and(|c| matches!(c, 'e' | 'E')) {
            let sign = usize::from(self.signs.get(at + 1).is_some_and(|c| matches!(c, '+' | '-')));
            if self.signs.get(at + 1 + sign).is_some_and(char::is_ascii_digit) {
                at += 1 + sign;
                digits(&mut at);
            }
        }
        let text: String = self.signs[begin..at].iter().collect();
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() => {
                self.at = at;
                Ok(self.put(Kind::Number(x), begin))
            }
            _ => Err(self.fault(&format!("'{text}' is no finite number"), "write numbers as 12.5 or 1e-3")),
        }
    }

    fn name(&mut self) -> Result<usize, Fault> {
        let begin = self.at;
        let mut at = begin;
        while self.signs.get(at).is_some_and(|c| c.is_ascii_alphanumeric() || *c == '_') {
            at += 1;
        }
        let name: String = self.signs[begin..at].iter().collect();
        let function = Function::ALL.iter().find(|(known, _)| *known == name).map(|(_, f)| *f);
        let mut after = at;
        while self.signs.get(after).is_some_and(|c| c.is_whitespace()) {
            after += 1;
        }
        let brackets = self.signs.get(after) == Some(&'(');
        if let Some(place) = self.names.iter().position(|known| *known == name)
            && !brackets
        {
            self.at = at;
            return Ok(self.put(Kind::Name(place), begin));
        }
        if name == "pi" && !brackets {
            self.at = at;
            return Ok(self.put(Kind::Number(std::f64::consts::PI), begin));
        }
        if brackets && (function.is_some() || name == "pow") {
            self.at = after + 1;
            return self.arguments(&name, function, begin, after);
        }
        let functions = Function::ALL.iter().map(|(known, _)| *known).chain(["pow"]);
        let problem = match (function, brackets) {
            (Some(_), false) => format!("the function {name} has no argument"),
            (None, true) => format!("there is no function '{name}'"),
            _ => format!("there is no quantity '{}'", cut(&name)),
        };
        let fix = match (function, brackets) {
            (Some(_), false) => format!("write {name}(...)"),
            (None, true) => nearest(&name, &functions.collect::<Vec<_>>()),
            _ => nearest(&name, self.names),
        };
        Err(self.fault(&problem, &fix))
    }

    fn arguments(
        &mut self,
        name: &str,
        function: Option<Function>,
        begin: usize,
        open: usize,
    ) -> Result<usize, Fault> {
        let first = self.deeper(Self::sum)?;
        let second = if self.takes(",") { Some(self.deeper(Self::sum)?) } else { None };
        let wrong = |count: &str| Fault {
            at: begin + 1,
            problem: format!("{name} takes {count}"),
            fix: "give it just that".into(),
        };
        if self.next() == Some(',') {
            return Err(wrong(if function.is_some() { "one argument" } else { "two arguments" }));
        }
        self.closed(open)?;
        match (function, second) {
            (Some(f), None) => Ok(self.put(Kind::Call(f, first), begin)),
            (None, Some(second)) => Ok(self.put(Kind::Pow(first, second), begin)),
            (Some(_), Some(_)) => Err(wrong("one argument")),
            (None, None) => Err(wrong("two arguments")),
        }
    }
}

/// The beginning of a name that may be long.
fn cut(name: &str) -> String {
    name.chars().take(40).collect()
}

/// The advice to write the known name that is nearest.
pub(crate) fn nearest(name: &str, known: &[&str]) -> String {
    let name = cut(name);
    let best = known.iter().map(|k| (distance(&name, k), k.len(), *k)).min();
    match best {
        Some((away, _, best)) if away <= 1 + best.len() / 3 => format!("did you mean {best}?"),
        _ => {
            format!("known here: {}", known.iter().take(MOST_LISTED).copied().collect::<Vec<_>>().join(", "))
        }
    }
}

/// Letters to change, insert or remove from one name to the other; a change of case is no change.
fn distance(a: &str, b: &str) -> usize {
    let (a, b) = (a.to_lowercase(), b.to_lowercase());
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut corner = i;
        row[0] = i + 1;
        for (j, y) in b.bytes().enumerate() {
            let change = corner + usize::from(x != y);
            corner = row[j + 1];
            row[j + 1] = change.min(row[j] + 1).min(corner + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fault(text: &str) -> Fault {
        parse(text, &["omega_m", "theta_e", "k"]).unwrap_err()
    }

    #[test]
    fn a_fault_names_its_place_and_the_way_out() {
        for (text, at, said, fix) in [
            ("k*omega", 3, "'omega'", "omega_m"),
            ("k*sinn(theta_e)", 3, "'sinn'", "did you mean sin?"),
            ("k*(omega_m", 3, "not closed", "close"),
            ("k*omega_m)", 10, "not opened", "remove"),
            ("k omega_m", 3, "does not go on", "operator"),
            ("k*", 3, "ends here", "complete"),
            ("k**/2", 4, "'/'", "number"),
            ("sin + 1", 1, "no argument", "sin(...)"),
            ("sin(k, k)", 1, "one argument", "just that"),
            ("pow(k)", 1, "two arguments", "just that"),
            ("pow(k, k, k)", 1, "two arguments", "just that"),
            ("1e999", 1, "'1e999'", "1e-3"),
            ("1.2.3", 1, "'1.2.3'", "12.5"),
            ("k·omega_m", 2, "\\u{b7}", "plain letters"),
            ("k*ω", 3, "\\u{3c9}", "omega_m"),
            ("k\u{0}", 2, "\\u{0}", "plain"),
            ("", 1, "ends here", "complete"),
            ("zzzzzzzzzz", 1, "zzz", "known here: omega_m, theta_e, k"),
        ] {
            let got = fault(text);
            assert_eq!(got.at, at, "{text}: {got:?}");
            assert!(got.problem.contains(said) && got.fix.contains(fix), "{text}: {got:?}");
        }
    }

    #[test]
    fn what_is_too_long_or_too_deep_is_refused_before_it_costs_anything() {
        for text in [
            "(".repeat(LONGEST),
            "-".repeat(LONGEST),
            "k**".repeat(LONGEST / 3),
            "sin(".repeat(LONGEST / 4),
            "(".repeat(10_000_000),
            "é".repeat(LONGEST + 1),
        ] {
            let got = fault(&text);
            assert!(
                got.problem.contains("deep")
                    || got.problem.contains("characters")
                    || got.problem.contains("xe9")
            );
        }
        assert!(parse(&"k+".repeat(LONGEST / 2 - 1).add_k(), &["k"]).is_ok());
    }

    trait AddK {
        fn add_k(self) -> String;
    }
    impl AddK for String {
        fn add_k(self) -> String {
            self + "k"
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[a-z0-9_+*/^().,eE \u{e9}-]{0,60}") {
            if let Ok(expression) = parse(&text, &["a", "b"]) {
                let _: f64 = expression.value(&[0.5, -2.0], &[1.0, 1.0]);
                let _ = super::super::checked_value(&expression, &[0.0, -2.0], &[1.0, 1.0]);
            }
        }
    }
}

use serde::{Deserialize, Serialize};

/// λ of eq. 13: a number, or "auto".
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "LambdaText", into = "LambdaText")]
pub enum Lambda {
    /// Chosen frame by frame from the measured noise; [`Lambda::PUBLISHED`] for the published model.
    Auto,
    /// This number.
    Fixed(f64),
}

impl Lambda {
    /// The value that the authors used for most of their laboratory measurements.
    pub const PUBLISHED: f64 = 0.05;
}

/// λ as written in a file.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum LambdaText {
    Number(f64),
    Word(String),
}

impl From<Lambda> for LambdaText {
    fn from(lambda: Lambda) -> Self {
        match lambda {
            Lambda::Auto => LambdaText::Word("auto".into()),
            Lambda::Fixed(number) => LambdaText::Number(number),
        }
    }
}

impl TryFrom<LambdaText> for Lambda {
    type Error = String;

    fn try_from(text: LambdaText) -> Result<Self, String> {
        match text {
            LambdaText::Number(number) => Ok(Lambda::Fixed(number)),
            LambdaText::Word(word) if word == "auto" => Ok(Lambda::Auto),
            LambdaText::Word(word) => Err(format!("lambda is \"{word}\", expected \"auto\" or a number above 0")),
        }
    }
}
